"""The verdict in plain sentences; `all_sentences.py` puts them in order."""
