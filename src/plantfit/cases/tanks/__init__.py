"""Cascaded tanks with overflow (Uppsala benchmark), training half."""
