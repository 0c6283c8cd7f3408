"""`handrail tablet`: the operator's window."""

from __future__ import annotations

import logging
import os
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

DEFAULT_ADDRESS = "tcp://127.0.0.1:47800"


def tablet(
    connect: Annotated[str, typer.Option(metavar="ADDRESS", help="The robot's link.")] = DEFAULT_ADDRESS,
    operator: Annotated[str, typer.Option(help="Your name, as the robot's log shows it.")] = "operator",
    size: Annotated[str, typer.Option(metavar="WxH", help="The window's size in pixels.")] = "1280x800",
    fullscreen: Annotated[bool, typer.Option("--fullscreen", help="Fill the screen.")] = False,
    antialiasing: Annotated[str, typer.Option(help="auto, off, still (smooth when nothing moves) or on.")] = "auto",
    shot: Annotated[Path | None, typer.Option(metavar="PNG", help="Save a picture of the window, then exit.")] = None,
    after: Annotated[float, typer.Option(metavar="S", help="With --shot: seconds to wait first.")] = 5.0,
) -> None:
    """Open the operator's window. It waits for the robot, and finds it again when the link comes back.

    STOP: the button, Escape or Space, from anywhere in the window. Enter presses what has the focus, Tab moves it.
    One finger or the left button turns the view, two fingers or the right button move it, pinch or wheel zoom.
    """
    from tablet_client import window as tablet_window

    modes = {
        "auto": None,
        "off": tablet_window.NO_ANTIALIASING,
        "still": tablet_window.WHEN_STILL,
        "on": tablet_window.ALWAYS,
    }
    if antialiasing not in modes:
        raise typer.BadParameter(f"got {antialiasing!r}; expected {', '.join(modes)}", param_hint="--antialiasing")
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        sys.exit(
            "handrail tablet: there is no screen (DISPLAY is not set); on a machine without one: xvfb-run -a handrail tablet …"
        )
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    raise typer.Exit(_run(connect, operator, _size(size), fullscreen, modes[antialiasing], shot, after))


def _run(
    address: str,
    operator: str,
    size: tuple[int, int],
    fullscreen: bool,
    antialiasing: int | None,
    shot: Path | None,
    after: float,
) -> int:
    from PySide6.QtCore import QTimer

    from handrail.client import connect
    from handrail.robot import description
    from tablet_client.session import Session
    from tablet_client.window import SUPERSAMPLED, application, open_window

    app = application()
    opened = open_window(
        address, description.load, mesh_cache(), size=size, antialiasing=antialiasing, operator=operator
    )
    if fullscreen:
        opened.window.showFullScreen()
    session = Session(lambda: connect(address, timeout_s=0), opened.desk.inbox)
    opened.desk.serve(session)
    session.start()

    # Python sees a signal only when it runs: let it run now and then while Qt sleeps.
    signal.signal(signal.SIGINT, lambda *_: app.quit())
    signal.signal(signal.SIGTERM, lambda *_: app.quit())
    awake = QTimer(interval=200)
    awake.timeout.connect(lambda: None)
    awake.start()

    status = 0

    def save() -> None:
        nonlocal status
        picture: Any = opened.window.grabWindow()
        if shot is not None and not picture.save(str(shot)):
            print(f"handrail tablet: can't write {shot}", file=sys.stderr)
            status = 1
        app.quit()

    if shot is not None:
        QTimer.singleShot(round(after * 1000), lambda: opened.window.setProperty("smoothing", SUPERSAMPLED))
        QTimer.singleShot(round(after * 1000) + 400, save)
    app.exec()
    session.close(timeout=0.5)
    opened.close()
    return status


def mesh_cache() -> Path:
    """Where prepared meshes are kept; can be deleted at any time."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "handrail" / "meshes"


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 640 and int(height) >= 480):
        raise typer.BadParameter(
            f"got {text!r}; expected WIDTHxHEIGHT, at least 640x480, e.g. 1280x800", param_hint="--size"
        )
    return int(width), int(height)
