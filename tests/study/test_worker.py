import subprocess
import sys

from plantfit.study.running.worker_names import STALE_SECONDS, is_stale, new_worker
from plantfit.study.versions import PACKAGES, cpu_model, versions


def test_a_claim_is_stale_when_silent_or_nobodys():
    me = new_worker()
    assert is_stale(None, None, 0.0)
    assert not is_stale(me, 100.0, 100.0 + STALE_SECONDS)
    assert is_stale(me, 100.0, 101.0 + STALE_SECONDS)


def test_a_process_that_ended_here_is_stale_at_once_and_one_elsewhere_is_not():
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    machine, _, started, token = new_worker().split("|")
    assert is_stale(f"{machine}|{ended.pid}|{started}|{token}", 100.0, 100.0)
    assert not is_stale(f"elsewhere|{ended.pid}|{started}|{token}", 100.0, 100.0)


def test_a_later_process_with_the_same_id_is_another_one():
    machine, pid, _, token = new_worker().split("|")
    assert is_stale(f"{machine}|{pid}|other start|{token}", 100.0, 100.0)


def test_versions_and_cpu(tmp_path):
    assert {"python", "searches", "engine", "system", *PACKAGES} == set(versions())
    (tmp_path / "cpuinfo").write_text("processor : 0\nmodel name : A Fast One\n")
    assert cpu_model(tmp_path / "cpuinfo") == "A Fast One"
    assert cpu_model(tmp_path / "missing")
