"""Export, import, merge: every bit travels, nothing is counted twice, a broken file is one sentence."""

import dataclasses
import json
import struct

import numpy as np
import polars as pl
import pytest
from study_fakes import FakeSearch, fake_result, objective, to_physical
from test_study_runner import bits
from test_study_store import NAMES, PLAN, add, claim_one, finish_one

from plantfit.errors import Status, StoreError
from plantfit.optimize.contract import RunResult
from plantfit.study import Plan, Store, resume, run

BACKENDS = ("sqlite", "postgresql")
KINDS = ("json", "parquet")
NAN = struct.unpack("<d", b"\x01\x00\x00\x00\x00\x00\xf8\x7f")[0]
ODD = np.array([0.1, np.nextafter(1, 2), 5e-324, -0.0, np.inf, -np.inf, np.nan, NAN])


def export(store, study_id, path):
    (store.export_json if path.suffix == ".json" else store.export_parquet)(study_id, path)
    return path


def odd_store(store):
    """A study with every odd float, an open task with a checkpoint and notes in any script."""
    names = tuple(f"p{k}" for k in range(len(ODD)))
    study_id = store.add(
        dataclasses.replace(PLAN, settings={"pso": {"population": 7}}),
        spec_text="é = '\\n'",
        coordinates=names,
        probe=ODD.tobytes(),
    )
    for claim in (store.claim(study_id, "w|1|2|3"), store.claim(study_id, "w|1|2|3")):
        results = [
            RunResult(
                claim.task.method,
                claim.task.first + k,
                2**40,
                ODD,
                ODD[-k - 3],
                1e15 / 3,
                1 / 3,
                Status.failed,
                ODD,
                ODD[::-1],
                3,
                extra,
            )
            for k, extra in zip(
                range(claim.task.count),
                ({"list": ODD.tolist(), "why": "NaN"}, {"tree": {"a": [1, 1.0, None]}}),
                strict=False,
            )
        ]
        store.finish(claim, results, [dict(zip(names, r.x.tolist(), strict=True)) for r in results])
    store.release(store.claim(study_id, "w|1|2|3"), b"\x00half way\xff")
    store.add_note(study_id, "Bemerkung: über 日本 \u2028 \"'")
    return study_id


@pytest.mark.parametrize("kind", KINDS)
def test_export_import_export_is_identical_and_so_is_the_study(store, tmp_path, kind):
    add(store)  # so that ids differ
    study_id = odd_store(store)
    one = export(store, study_id, tmp_path / f"one.{kind}")
    other = Store.open(tmp_path / "other.db")
    imported = other.import_file(one)
    assert export(other, imported, tmp_path / f"two.{kind}").read_bytes() == one.read_bytes()
    back = store.import_file(tmp_path / f"two.{kind}")
    assert back > study_id
    assert export(store, back, tmp_path / f"three.{kind}").read_bytes() == one.read_bytes()
    assert bits(other.runs(imported)) == bits(store.runs(study_id)) == bits(store.runs(back))
    whole, again = store.whole(study_id), store.whole(back)
    assert again.tasks == whole.tasks
    assert again.probe == whole.probe == ODD.tobytes()
    assert dataclasses.replace(again.study, id=study_id) == whole.study
    assert struct.pack("<d", other.runs(imported)[0].cost) == struct.pack("<d", ODD[-3])


def test_both_kinds_hold_the_same(store, tmp_path):
    study_id = odd_store(store)
    found = [store.import_file(export(store, study_id, tmp_path / f"s.{kind}")) for kind in KINDS]
    a, b = (export(store, k, tmp_path / f"{k}.json").read_bytes() for k in found)
    assert a == b
    json.loads(a, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("after", [0, 3])
@pytest.mark.further(2)
def test_an_unfinished_study_goes_on_where_it_is_brought(store, tmp_path, kind, after):
    plan = Plan(name="p", methods=("random", "pso"), runs=5, budget=40, seed=4, chunk=2)
    search = FakeSearch()
    study_id = run(
        plan, objective(), store, to_physical=to_physical, stop=lambda: len(search.done) >= after, search=search
    )
    other = Store.open(tmp_path / "other.db")
    imported = other.import_file(export(store, study_id, tmp_path / f"s.{kind}"), spec_path="/here/s.toml")
    assert other.study(imported).state == "interrupted"
    assert other.study(imported).spec_path == "/here/s.toml"
    resume(other, imported, objective(), to_physical=to_physical, search=search)
    assert sorted(search.done) == sorted((m, k) for m in plan.methods for k in range(5))  # the checkpoint came along
    resume(store, study_id, objective(), to_physical=to_physical, search=FakeSearch())
    assert bits(other.runs(imported)) == bits(store.runs(study_id))


def spoilt(edit):
    def apply(text):
        record = json.loads(text)
        edit(record)
        return json.dumps(record)

    return apply


SPOILT = {
    "cut off": (lambda text: text[: len(text) // 2], "is not an exported study, or broken"),
    "empty": (lambda text: "", "is not an exported study, or broken"),
    "a list": (lambda text: "[1, 2]", 'does not say "plantfit study"'),
    "other program": (lambda text: '{"format": "notes"}', 'does not say "plantfit study"'),
    "newer": (spoilt(lambda r: r.update(format="plantfit study 99")), "plantfit study 99.*or update this one"),
    "no cost": (spoilt(lambda r: r["runs"][1].pop("cost")), r"runs\[1\] lacks 'cost'"),
    "text for a number": (spoilt(lambda r: r["runs"][1].update(cost="low")), r"runs\[1\].*'low' in place of a number"),
    "null for a number": (spoilt(lambda r: r["runs"][0]["x"].__setitem__(0, None)), r"runs\[0\]"),
    "huge": (spoilt(lambda r: r["runs"][1].update(run=2**70)), r"runs\[1\]"),
    "status": (spoilt(lambda r: r["runs"][1].update(status="odd")), r"runs\[1\].*odd"),
    "run twice": (spoilt(lambda r: r["runs"].__setitem__(1, r["runs"][0])), "runs are not those"),
    "run lost": (spoilt(lambda r: r["runs"].pop()), "has 1 runs, and 2 in its finished tasks"),
    "short x": (spoilt(lambda r: r["runs"][0]["x"].pop()), "has 2 coordinates of 3"),
    "short history": (spoilt(lambda r: r["runs"][0]["history_cost"].pop()), "histories of unequal length"),
    "task lost": (spoilt(lambda r: r["tasks"].pop()), "tasks are not those of its plan"),
    "task twice": (spoilt(lambda r: r["tasks"].append(r["tasks"][-1])), "tasks are not those of its plan"),
    "checkpoint": (spoilt(lambda r: r["tasks"][1].update(checkpoint="?")), r"tasks\[1\]"),
    "plan": (spoilt(lambda r: r["study"].update(plan={"methods": "pso"})), r"study.*methods"),
    "runs": (spoilt(lambda r: r.update(runs={})), "runs: dict in place of a list"),
    "extra": (spoilt(lambda r: r["runs"][0].update(extra=[])), r"runs\[0\].*in place of a table"),
}


@pytest.mark.parametrize("case", SPOILT)
def test_a_broken_or_foreign_file_is_one_sentence_and_adds_nothing(sqlite_store, tmp_path, case):
    edit, told = SPOILT[case]
    study_id = add(sqlite_store)
    finish_one(sqlite_store, study_id)
    path = export(sqlite_store, study_id, tmp_path / "s.json")
    path.write_text(edit(path.read_text()))
    with pytest.raises(StoreError, match=told) as caught:
        sqlite_store.import_file(path)
    assert str(caught.value).startswith(f"{path} ")
    assert "\n" not in str(caught.value)
    assert [s.id for s in sqlite_store.studies()] == [study_id]


def test_broken_and_foreign_parquet_files(sqlite_store, tmp_path):
    store, study_id = sqlite_store, add(sqlite_store)
    finish_one(store, study_id)
    whole = export(store, study_id, tmp_path / "s.parquet").read_bytes()
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "foreign.parquet")
    text = pl.read_parquet_metadata(tmp_path / "s.parquet")["plantfit"]
    frame = pl.read_parquet(tmp_path / "s.parquet")
    frame.drop("cost").write_parquet(tmp_path / "columns.parquet", metadata={"plantfit": text})
    frame.with_columns(pl.lit("odd").alias("x")).write_parquet(tmp_path / "types.parquet", metadata={"plantfit": text})
    frame.with_columns(pl.lit(None).cast(pl.Float64).alias("cost")).write_parquet(
        tmp_path / "nulls.parquet", metadata={"plantfit": text}
    )
    frame[:1].write_parquet(tmp_path / "fewer.parquet", metadata={"plantfit": text})
    frame.write_parquet(tmp_path / "newer.parquet", metadata={"plantfit": text.replace("study 2", "study 3")})
    (tmp_path / "cut.parquet").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "noise.parquet").write_bytes(whole[:4] + bytes(200) + whole[204:])
    said = {
        "foreign": "another program",
        "columns": "row 0 lacks 'cost'",
        "types": "the columns: ",
        "nulls": "row 0: ",
        "fewer": "has 1 runs, and 2",
        "newer": "or update this one",
        "cut": "broken Parquet file",
        "noise": "broken",
    }
    for name, told in said.items():
        with pytest.raises(StoreError, match=told) as caught:
            store.import_file(tmp_path / f"{name}.parquet")
        assert "\n" not in str(caught.value), name
    with pytest.raises(StoreError, match="cannot be read"):
        store.import_file(tmp_path / "nowhere.json")
    with pytest.raises(StoreError, match="plantfit merge"):
        store.import_file(store.name)
    assert len(store.studies()) == 1


# merge


def test_the_same_study_at_two_places_becomes_one(store, tmp_path):
    here, there = store, Store.open(tmp_path / "there.db")
    add(there)  # so that ids differ
    plan = dataclasses.replace(PLAN, runs=5)
    probe = np.linspace(0, 1, 6).tobytes()
    ours, theirs = (s.add(plan, spec_text="x", coordinates=NAMES, probe=probe) for s in (here, there))
    for s, study_id, wanted in ((here, ours, (0, 1)), (there, theirs, (1, 2, 3))):
        claims = [claim_one(s, study_id, "elsewhere|1|2|a") for _ in range(5)]
        for k, claim in enumerate(claims):
            if k in wanted:
                results = [fake_result(PLAN, claim.task.method, claim.task.first + i) for i in range(claim.task.count)]
                s.finish(claim, results, [dict(zip(NAMES, r.x.tolist(), strict=True)) for r in results])
            else:
                s.release(claim, b"there" if s is there and k == 4 else None)
    sizes = [claim.task.count for claim in claims]
    added, equal = sizes[2] + sizes[3], sizes[1]
    found = here.merge(there.whole(theirs), "there.db")
    assert (found.study, found.new, found.added, found.equal, found.different) == (ours, False, added, equal, 0)
    assert here.study(ours).runs_done == sum(sizes[:4])
    (note,) = here.study(ours).notes
    assert note.startswith(f"{added} runs came from study {theirs} of there.db (begun ")
    assert f"{equal} runs were here already with the same bits" in note
    once = {(r.method, r.run): r.cost for r in here.runs(ours)}
    assert once == {key: fake_result(PLAN, *key).cost for key in once}
    again = here.merge(there.whole(theirs), "there.db")
    assert (again.added, again.equal, again.notes) == (0, added + equal, ())
    assert here.claim(ours, "elsewhere|1|2|b").checkpoint == b"there"
    last = here.claim(ours, "elsewhere|1|2|b")
    assert last is not None
    back = there.merge(here.whole(ours), "here")
    assert (back.study, back.added, back.equal) == (theirs, sizes[0], added + equal)


def test_other_bits_are_told_and_what_is_here_stays(store, tmp_path):
    there = Store.open(tmp_path / "there.db")
    ours, theirs = add(store), add(there)
    for s, study_id, nudge in ((store, ours, 0.0), (there, theirs, 1e-16)):
        for _ in range(4):
            claim = claim_one(s, study_id)
            results = [fake_result(PLAN, claim.task.method, claim.task.first + k) for k in range(claim.task.count)]
            results = [dataclasses.replace(r, cost=r.cost + nudge, seconds=9.0 + nudge) for r in results]
            s.finish(claim, results, [{}] * len(results))
    before = bits(store.runs(ours))
    found = store.merge(there.whole(theirs), "there.db")
    assert (found.added, found.equal + found.different) == (0, 6)
    assert found.different > 0
    (note,) = store.study(ours).notes
    assert "of 'random' differs from that of study 1 of there.db" in note
    assert "in cost (0." in note
    assert note.endswith("those here are kept.")
    assert bits(store.runs(ours)) == before


def test_different_studies_come_as_new_ones_with_a_note(store, tmp_path):
    there = Store.open(tmp_path / "there.db")
    add(store)
    makers = (
        lambda s: add(s, dataclasses.replace(PLAN, seed=5)),
        lambda s: s.add(PLAN, spec_text="other", coordinates=NAMES, probe=b""),
        lambda s: s.add(PLAN, spec_text="name = 'gearmotor'", coordinates=("a", "b", "d"), probe=b""),
        lambda s: s.add(PLAN, spec_text="name = 'gearmotor'", coordinates=NAMES, probe=np.ones(6).tobytes()),
    )
    for make in makers:
        finish_one(there, make(there))
    found = [store.merge(there.whole(s.id), "there.db") for s in there.studies()]
    assert all(f.new and f.added == 2 for f in found)
    assert len({f.study for f in found}) == 4
    for f, s in zip(found, there.studies(), strict=True):
        assert bits(store.runs(f.study)) == bits(there.runs(s.id))
        (note,) = store.study(f.study).notes
        assert note.startswith(f"Came from study {s.id} of there.db (begun {s.created} on ")
        again = store.merge(there.whole(s.id), "there.db")
        assert (again.study, again.new, again.added, again.equal) == (f.study, False, 0, 2)


def test_a_probe_may_differ_by_rounding_only(store, tmp_path):
    there = Store.open(tmp_path / "there.db")
    probe = np.linspace(1, 2, 6)
    ours = store.add(PLAN, spec_text=None, coordinates=NAMES, probe=probe.tobytes())
    near, far = (
        there.add(PLAN, spec_text=None, coordinates=NAMES, probe=(probe * f).tobytes()) for f in (1 + 1e-12, 1.001)
    )
    assert store.merge(there.whole(near), "there").study == ours
    assert store.merge(there.whole(far), "there").new


def test_runs_of_another_machine_name_its_cpu(store, tmp_path):
    there = Store.open(tmp_path / "there.db")
    ours, theirs = add(store), add(there)
    finish_one(there, theirs)
    whole = there.whole(theirs)
    other = dataclasses.replace(whole, study=dataclasses.replace(whole.study, cpu="A Fast One", notes=("A note.",)))
    store.merge(other, "there.db")
    first, note = store.study(ours).notes
    assert first == "A note."
    assert "CPU A Fast One there" in note


def test_a_worker_whose_task_came_from_elsewhere_adds_nothing(store, tmp_path):
    """Merging finishes the task that a live worker holds; the worker's runs are the same and must not count again."""
    plan = Plan(name="p", methods=("random",), runs=2, budget=40, seed=4, chunk=2)
    there = Store.open(tmp_path / "there.db")
    theirs = run(plan, objective(), there, search=FakeSearch())

    def bring(task, k):
        store.merge(there.whole(theirs), "there.db")

    ours = run(plan, objective(), store, search=FakeSearch(bring))
    assert bits(store.runs(ours)) == bits(there.runs(theirs))
    assert store.study(ours).state == "done"
