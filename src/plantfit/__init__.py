"""plantfit: physical parameters that can be trusted, from recordings of machines and processes."""
