"""A serial port: opened, read and written without waiting; what goes wrong is said in a sentence."""

import contextlib
import errno
import os
import re
from typing import Any

from plantfit.errors import BoardError, MissingExtra

_WRITE_SECONDS = 0.2


class LinkDown(Exception):
    """The port went away or does not take bytes; the recorder connects again."""


class Link:
    """An open serial port. BoardError where it cannot be opened, MissingExtra without pyserial."""

    def __init__(self, port: str, baud: int):
        serial = _pyserial()
        self._failures = (serial.SerialException, OSError)
        try:
            self._port: Any = serial.serial_for_url(port, baud, timeout=0, write_timeout=_WRITE_SECONDS, exclusive=True)
        except (ValueError, OverflowError) as error:
            raise BoardError(
                f"Port {port} cannot run at {baud} baud ({error}); choose a rate that the board and the adapter know."
            ) from None
        except self._failures as error:
            raise BoardError(_why_not(port, error)) from None

    def read(self) -> bytes:
        """The bytes that have come, perhaps none. Raises LinkDown."""
        try:
            waiting = self._port.in_waiting
            return self._port.read(waiting) if waiting else b""
        except (*self._failures, TypeError) as error:  # TypeError: pyserial, when another thread closed the port
            raise LinkDown(str(error)) from None

    def write(self, data: bytes) -> None:
        """Raises LinkDown where the port does not take `data` in time."""
        try:
            self._port.write(data)
        except self._failures as error:
            raise LinkDown(str(error)) from None

    def close(self) -> None:
        """Close, whatever state the port is in."""
        with contextlib.suppress(*self._failures):
            self._port.close()


def ports() -> list[str]:
    """Serial ports that this machine has."""
    _pyserial()
    from serial.tools import list_ports

    return sorted(p.device for p in list_ports.comports())


def _pyserial() -> Any:
    try:
        import serial
    except ImportError:
        raise MissingExtra(
            "Recording from a board needs the package pyserial; install it with: pip install 'plantfit[board]'"
        ) from None
    return serial


def _why_not(port: str, error: Exception) -> str:
    code, text = getattr(error, "errno", None), str(error)
    if os.name == "nt" and (
        inner := re.search(r"(\w*Error)\(\d+, ['\"](.*?)['\"]", text)
    ):  # pyserial says so, and gives no number
        code, text = {"FileNotFoundError": errno.ENOENT, "PermissionError": errno.EBUSY}.get(inner[1]), inner[2]
    if code == errno.ENOENT or not (os.path.exists(port) or "://" in port or os.name == "nt"):
        found = ports()
        return f"There is no port {port}; " + (
            f"this machine has {', '.join(found)}; name the port of the board."
            if found
            else "this machine has no serial port now; plug the board in."
        )
    if code in (errno.EACCES, errno.EPERM):
        return (
            f"Port {port} may not be used by this user; add the user to "
            "the group that owns it (often dialout) and log in again."
        )
    if code in (errno.EAGAIN, errno.EBUSY) or "lock" in text:
        return f"Port {port} is in use by another program; close that program first."
    if code in (errno.ENOTTY, errno.EINVAL, errno.EISDIR) or "configure port" in text:
        return f"{port} is not a serial port; give the board's port, as in /dev/ttyACM0 or COM3."
    return f"Port {port} cannot be opened ({text}); check the cable and the name."
