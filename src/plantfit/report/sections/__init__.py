"""Tables and sections of the report."""
