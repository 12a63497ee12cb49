"""Files and arrays to recordings: columns, clocks, numbers; `any_format.py` picks the reader."""
