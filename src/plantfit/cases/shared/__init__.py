"""What the demos share: the registry, their files, stages with progress, records and figures."""
