"""An equilibrium, unstable ones too, held by state feedback with a filter on all plants that the data allow."""
