"""Exit with 1 and a sentence where this Python is none that pyproject.toml allows; any Python 3 can run it."""

import os
import re
import sys


def allowed(requires, version):
    """Whether a version (major, minor) satisfies a text such as ">=3.11,<3.14"."""
    for sign, major, minor in re.findall(r"(>=|<)(\d+)\.(\d+)", requires):
        bound = (int(major), int(minor))
        if (version < bound) if sign == ">=" else (version >= bound):
            return False
    return True


def main():
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "pyproject.toml")) as file:
        requires = re.search(r'^requires-python = "(.*)"$', file.read(), re.MULTILINE).group(1)  # pyrefly: ignore[missing-attribute]
    if not allowed(requires, sys.version_info[:2]):
        here = "{}.{}".format(*sys.version_info[:2])
        sys.stderr.write(f"plantfit needs Python {requires}, and {sys.executable} is {here}; ")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
