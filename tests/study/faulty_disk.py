"""Run as a script by test_store_faults.py, with faults.c preloaded: a study on a disk that fails, or a process that
ends, at call number n.

python faulty_disk.py LIBRARY FOLDER STRIDE     prints one JSON line: calls, trials by kind, and what was wrong
"""

import ctypes
import json
import os
import shutil
import sqlite3
import sys
import traceback
from pathlib import Path

from many_workers import NAMES, plan, result

from plantfit.errors import StoreError
from plantfit.study import Store
from plantfit.study.running.worker_names import new_worker

KINDS = {"killed": 1, "torn": 2, "input/output error": 3, "disk full": 4}
RUNS = 3


def study(folder: Path, acknowledged: int) -> None:
    """Make a store, work off a study and export it; each finished run and each export is told to the pipe once the
    call has returned."""
    store = Store.open(folder / "study.db", busy_timeout=0.2)
    study_id = store.add(plan("faulty", RUNS), spec_text="name = 'x'", coordinates=NAMES, probe=b"\0" * 64)
    os.write(acknowledged, b"study\n")
    me = new_worker()
    while (claim := store.claim(study_id, me)) is not None:
        store.beat(claim, 1.0)
        store.save_checkpoint(claim, b"on the way")
        task = claim.task
        results = [result(task.method, task.first + k) for k in range(task.count)]
        store.finish(claim, results, [dict(zip(NAMES, r.x.tolist(), strict=True)) for r in results])
        os.write(acknowledged, "".join(f"{r.method} {r.run}\n" for r in results).encode())
        store.settle(study_id, active=True)
    store.export_json(study_id, folder / "study.json")
    os.write(acknowledged, b"export\n")


def trial(library, folder: Path, number: int, kind: int) -> tuple[list[str], str, int]:
    """What was acknowledged, how the process ended, and the calls that it made."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        said = "whole"
        try:
            library.fault_arm(str(folder).encode(), number, kind)
            study(folder, writing)
        except StoreError as error:
            said = f"sentence {error}"
        except BaseException:
            said = f"traceback {traceback.format_exc()}"
        os.write(writing, f"calls {library.fault_seen()}\nended {json.dumps(said)}\n".encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as told:
        lines = told.read().splitlines()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    calls = next((int(line.split()[1]) for line in lines if line.startswith("calls")), -1)
    ended = next((json.loads(line[6:]) for line in lines if line.startswith("ended")), f"signal {-status}")
    return [line for line in lines if not line.startswith(("calls", "ended"))], ended, calls


def wrong(folder: Path, acknowledged: list[str], ended: str, kind: str) -> str | None:
    """What is wrong with what the process has left behind, or None."""
    if ended.startswith("traceback"):
        return ended
    if ended.startswith("sentence") and ("\n" in ended or "study" not in ended):
        return ended
    if kind in ("killed", "torn") and ended not in ("signal 9", "whole"):
        return f"ended by {ended}"
    place = folder / "study.db"
    told = [tuple(line.split()) for line in acknowledged if " " in line]
    if "study" not in acknowledged and not place.exists():
        return None
    try:
        store = Store.open(place, busy_timeout=0.2)  # once the disk works again
        studies = store.studies()
        if "study" in acknowledged and len(studies) != 1:
            return f"{len(studies)} studies are there"
        for one in studies:
            runs = {(r.method, str(r.run)): r for r in store.runs(one.id)}
            if missing := [pair for pair in told if pair not in runs]:
                return f"acknowledged and lost: {missing}"
            for r in runs.values():
                if r.x.tobytes() != result(r.method, r.run).x.tobytes():
                    return f"other bits in {r.method} {r.run}"
            go_on(store, one.id)
            whole = [(r.method, r.run) for r in store.runs(one.id)]
            if whole != [(m, k) for m in plan("faulty", RUNS).methods for k in range(RUNS)]:
                return f"not whole after going on: {whole}"
        with sqlite3.connect(place) as connection:
            (check,) = connection.execute("PRAGMA integrity_check").fetchone()
        connection.close()
        if check != "ok":
            return str(check)
        if (folder / "study.json").exists():
            store.import_file(folder / "study.json")  # whole wherever it is there
        elif "export" in acknowledged:
            return "the export is lost"
    except StoreError as error:
        return f"not readable after it: {error}"
    return None


def go_on(store: Store, study_id: int) -> None:
    me = new_worker()
    while (claim := store.claim(study_id, me)) is not None:
        results = [result(claim.task.method, claim.task.first + k) for k in range(claim.task.count)]
        store.finish(claim, results, [dict(zip(NAMES, r.x.tolist(), strict=True)) for r in results])


def main(library: str, place: str, stride: int) -> None:
    shim = ctypes.CDLL(library)
    empty = Path(place)

    def fresh() -> Path:
        shutil.rmtree(empty, ignore_errors=True)
        empty.mkdir()
        return empty

    _, ended, calls = trial(shim, fresh(), 1 << 30, 0)
    assert ended == "whole", ended
    trials, found = dict.fromkeys(KINDS, 0), []
    for kind, number in KINDS.items():
        for n in range(number % stride, calls, stride):  # all calls after `stride` kinds' worth of trials
            acknowledged, ended, _ = trial(shim, fresh(), n, number)
            trials[kind] += 1
            if (what := wrong(empty, acknowledged, ended, kind)) is not None:
                found.append([kind, n, acknowledged, what])
    print(json.dumps({"calls": calls, "trials": trials, "found": found}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
