"""The database of studies, and studies in and out of it."""
