"""Tests of what a fit leaves: white or not, odd in one part, like noise that is correlated."""
