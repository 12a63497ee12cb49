"""`schema_version` of the findings grows where keys go or become of another kind: their list is kept in
findings_keys.txt.

`python tests/trust/test_findings_version.py` writes the list anew: after keys were added, or with another VERSION.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from plantfit.findings.whole import VERSION, findings_schema

LIST = Path(__file__).parent / "findings_keys.txt"


def keys(schema: dict[str, Any]) -> dict[str, str]:
    """Every key of a JSON schema as a path, `a.b` in an object and `a[].b` in a list of objects, and its kind."""
    return dict(_of(schema, schema["$defs"], ""))


def _of(node: dict[str, Any], known: dict[str, Any], path: str) -> Iterator[tuple[str, str]]:
    node = known[node["$ref"].rsplit("/", 1)[1]] if "$ref" in node else node
    for one in node.get("anyOf", ()):
        yield from _of(one, known, path)
    if isinstance(node.get("items"), dict):
        yield from _of(node["items"], known, f"{path}[]")
    if isinstance(node.get("additionalProperties"), dict):
        yield from _of(node["additionalProperties"], known, f"{path}{{}}")
    for key, own in node.get("properties", {}).items():
        at = f"{path}.{key}" if path else key
        yield at, "|".join(sorted(_kinds(own, known)))
        yield from _of(own, known, at)


def _kinds(node: dict[str, Any], known: dict[str, Any]) -> set[str]:
    if "$ref" in node:
        return _kinds(known[node["$ref"].rsplit("/", 1)[1]], known)
    if "anyOf" in node:
        return set().union(*(_kinds(n, known) for n in node["anyOf"]))
    if "enum" in node or "const" in node:
        return {repr(v) for v in node.get("enum", [node.get("const")])}
    return {node.get("type", "anything")}


def listed() -> tuple[int, dict[str, str]]:
    """The version of the list, and its keys."""
    first, *lines = LIST.read_text(encoding="utf-8").splitlines()
    return int(first.removeprefix("version ")), dict(line.split("\t") for line in lines)


def wrong(version: int, kept: dict[str, str], now: dict[str, str]) -> list[str]:
    """What is against the rule, in sentences."""
    if version != VERSION:
        return [f"The list is of version {version} and the findings of {VERSION}: write it anew."]
    broken = [k for k, before in kept.items() if _less(before, now.get(k))]
    fresh = [k for k, kind in now.items() if kind != kept.get(k) and k not in broken]
    told = [f"{k} was {kept[k]} and is {now.get(k, 'gone')}: raise VERSION in findings/whole.py." for k in broken]
    return told + [f"{k} is not in the list as it is: write it anew, in the same version." for k in fresh]


def _less(before: str, now: str | None) -> bool:
    """Whether a reader of the kinds before meets another one, or none."""
    return now is None or not set(now.split("|")) <= set(before.split("|"))


def test_keys_that_go_or_change_raise_the_version():
    assert not wrong(*listed(), keys(findings_schema()))


@pytest.mark.parametrize("change", ["gone", "another kind", "may be null", "added", "an older list"])
@pytest.mark.further(3)
def test_the_list_tells(change):
    version, kept = listed()
    now = keys(findings_schema())
    key = next(k for k in now if now[k] == "string")
    if change == "gone":
        del now[key]
    elif change == "another kind":
        now[key] = "number"
    elif change == "may be null":
        now[key] = "null|string"
    elif change == "added":
        now["parameters[].colour"] = "string"
    else:
        version -= 1
    (said,) = wrong(version, kept, now)[:1]
    assert ("raise VERSION" in said) == (change in ("gone", "another kind", "may be null"))
    assert change == "an older list" or said.startswith(
        "parameters[].colour" if change == "added" else f"{key} was string"
    )


def test_every_level_is_in_the_list():
    kept = listed()[1]
    assert kept["parameters[].by_noise.low"] == "null|number"
    assert kept["diagnosis.rounds[].tried[].kind"] == "string"
    assert len(kept) > 200


if __name__ == "__main__":
    lines = [f"{k}\t{v}" for k, v in sorted(keys(findings_schema()).items())]
    LIST.write_text("\n".join([f"version {VERSION}", *lines]) + "\n", encoding="utf-8")
