"""PIDs whose gains follow the operating point: the law, and its gains at every level on all plants that the data
allow."""
