"""Forms of controllers that one search and one judgement serve, a file each."""
