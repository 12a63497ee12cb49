"""Commands for a recording that has no model yet."""
