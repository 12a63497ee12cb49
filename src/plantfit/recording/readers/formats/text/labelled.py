"""Lines in which every number has its label, as boards print them: t:0,pwm:120,rpm:3.5 or t=0 pwm=120 rpm=3.5."""

import re
from collections import Counter
from collections.abc import Sequence

LEAST = 5  # lines
MOST_OF = 0.8  # of all lines that are so: others are told as lines that do not fit the table
_LABEL = r"[^\W\d]\w*(?:\s*\[[^\]]*\]|\s*\([^)]*\))?"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[nN][aA][nN]|null"
_PAIR = re.compile(rf"\s*\"?({_LABEL})\"?\s*[:=]\s*({_NUMBER})\s*(?:[,;|]\s*|(?=\s)|$)")


def pairs_of(line: str, least: int = 2) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Labels and numbers of a line that holds `least` pairs of them or more and nothing else, in braces or not."""
    text = line.strip()
    if text[:1] + text[-1:] == "{}":
        text = text[1:-1]
    found, at = [], 0
    while at < len(text):
        pair = _PAIR.match(text, at)
        if pair is None:
            return None
        found.append((pair[1], pair[2].replace("null", "nan")))
        at = pair.end()
    labels, numbers = zip(*found, strict=True) if found else ((), ())
    return (labels, numbers) if len(found) >= least and len(set(labels)) == len(labels) else None


def table_of_labels(lines: Sequence[str], numbers: Sequence[int], least: int = 2) -> tuple[list[str], list[int]] | None:
    """Lines and their numbers with the labels as a header and the numbers with commas between; None where most lines
    are no `least` pairs, or not of the same labels. Lines that are none stay as they are."""
    if sum(pairs_of(line, least) is not None for line in lines[:50]) < min(LEAST, 0.5 * len(lines[:50])):
        return None
    found = [pairs_of(line, least) for line in lines]
    labels, count = Counter(p[0] for p in found if p).most_common(1)[0] if any(found) else ((), 0)
    if count < max(LEAST, MOST_OF * len(lines)):
        return None
    rows = [",".join(p[1]) if p and p[0] == labels else line for p, line in zip(found, lines, strict=True)]
    first = next(k for k, p in enumerate(found) if p and p[0] == labels)
    head = ",".join(labels)
    return [*rows[:first], head, *rows[first:]], [*numbers[:first], numbers[first], *numbers[first:]]
