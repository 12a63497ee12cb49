"""From the runs of a search to the final problem: steps, weights, strengths of smoothing, agreement of the runs."""
