"""From a jaxpr to the graph; one rule for each primitive of lax."""
