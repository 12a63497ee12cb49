"""Parameters by several methods from the same recordings: noise levels proposed and found, filters over all
recordings in turn."""
