"""The readers of files, by kind of file; `recording/readers/any_format.py` lists them by the ending of the name."""
