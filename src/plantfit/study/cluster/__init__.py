"""Tasks of studies on a Dask cluster: the driver here, what its workers do there."""
