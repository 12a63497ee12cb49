"""The fitted plant as a function of its inputs and of additions, and its fits."""
