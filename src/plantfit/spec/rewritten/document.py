"""The text of a changed TOML document."""

import re

import tomlkit


def text_of(document: tomlkit.TOMLDocument) -> str:
    """The document as text; equations in three quotes begin on a line of their own, as they were written."""
    # TOML leaves out a newline behind the quotes, which tomlkit does not write
    return re.sub(r'(equations\s*=\s*""")(?!\n)', r"\1\n", tomlkit.dumps(document), count=1)
