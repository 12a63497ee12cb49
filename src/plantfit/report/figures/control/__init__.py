"""Figures of closed loops and families of plants."""
