"""Pages beside the report of a fit: a tuned controller, the next experiment."""
