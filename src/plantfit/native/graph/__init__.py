"""The graph between jaxpr and LLVM: nodes, their arithmetic, elementary functions."""
