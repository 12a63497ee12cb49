"""A filter that watches a plant on line: what its innovations say of every parameter, and a test that is made again
and again."""
