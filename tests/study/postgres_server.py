"""A private PostgreSQL for tests: its own folder, a unix socket and no port, gone at the end."""

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

USER = "plantfit"
PATIENCE = 30.0


def missing() -> str | None:
    """Why there can be no server here, or None."""
    if find_spec("psycopg") is None:
        return "the package psycopg is not installed (pip install 'plantfit[postgres]')"
    if programs() is None:
        return "no PostgreSQL server is installed (Debian: apt-get install postgresql)"
    if os.name != "posix" or (os.getuid() == 0 and _other_user() is None):
        return "PostgreSQL refuses to run as root and there is no user postgres or nobody"
    return None


def programs() -> Path | None:
    """The folder of the newest initdb: Debian's, or that of the search path."""
    debian = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda p: float(p.parts[4]))
    found = debian[-1] if debian else shutil.which("initdb")
    return None if found is None else Path(found).parent


@contextmanager
def server() -> Generator[Path]:
    """A running server; yields the folder of its socket."""
    folder, bin_ = Path(tempfile.mkdtemp(prefix="plantfit-pg-")), programs()
    assert bin_ is not None
    who = _who()
    if who:
        shutil.chown(folder, who["user"])
    try:
        make = [
            bin_ / "initdb",
            "-D",
            folder / "data",
            "-A",
            "trust",
            "-U",
            USER,
            "-E",
            "UTF8",
            "--locale=C",
            "--no-sync",
        ]
        subprocess.run(make, check=True, capture_output=True, cwd=folder, **who)
        start(folder)
        try:
            yield folder
        finally:
            stop(folder)
    finally:
        shutil.rmtree(folder)


_running: dict[Path, subprocess.Popen] = {}


def start(folder: Path) -> None:
    """Start the server of a folder, and wait until it answers."""
    bin_ = programs()
    assert bin_ is not None
    # not safe against a crash of the machine, which a test does not mind
    quick = ["fsync=off", "full_page_writes=off", "max_connections=60", "shared_buffers=16MB", "listen_addresses="]
    run = [
        bin_ / "postgres",
        "-D",
        folder / "data",
        "-k",
        folder,
        *(word for setting in quick for word in ("-c", setting)),
    ]
    with (folder / "log").open("ab") as log:
        _running[folder] = subprocess.Popen(run, stdout=log, stderr=log, cwd=folder, **_who())
    _wait(_running[folder], folder)


def stop(folder: Path) -> None:
    """Stop it at once, as a power failure would."""
    process = _running.pop(folder, None)
    if process is not None:
        process.send_signal(signal.SIGQUIT)
        process.wait()


def _who() -> dict[str, Any]:
    """As which user it runs: not as root."""
    user = _other_user() if os.getuid() == 0 else None
    return {} if user is None else {"user": user, "group": pwd.getpwnam(user).pw_gid, "extra_groups": []}


def new_database(folder: Path, name: str) -> str:
    """An empty database; returns its SQLAlchemy address."""
    import psycopg
    from psycopg import sql

    with psycopg.connect(host=str(folder), user=USER, dbname="postgres", autocommit=True) as connection:
        connection.execute(sql.SQL("CREATE DATABASE {}").format(sql.Identifier(name)))
    return address(folder, name)


def libpq(place: str) -> str:
    """The address as PostgreSQL's own programs write it."""
    return place.replace("+psycopg", "")


def address(folder: Path, name: str) -> str:
    return f"postgresql+psycopg://{USER}@/{name}?host={folder}"


def _other_user() -> str | None:
    known = {entry.pw_name for entry in pwd.getpwall()}
    return next((name for name in ("postgres", "nobody") if name in known), None)


def _wait(process: subprocess.Popen, folder: Path) -> None:
    import psycopg

    limit = time.monotonic() + PATIENCE
    while True:
        try:
            psycopg.connect(host=str(folder), user=USER, dbname="postgres").close()
            return
        except psycopg.OperationalError:
            if process.poll() is not None or time.monotonic() > limit:
                raise RuntimeError((folder / "log").read_text()) from None
            time.sleep(0.05)
