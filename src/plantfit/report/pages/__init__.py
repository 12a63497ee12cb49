"""Pages beside the report of a fit, each from a plain record: what `look`, `sensitivity`, `compare` of models,
`compare-records`, `intervals`, `estimate`, `tune` and `design` found."""
