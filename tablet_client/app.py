"""`handrail tablet`: the operator's window."""

from __future__ import annotations

import logging
import os
import signal
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from handrail.client import DEFAULT_ADDRESS, connect
from handrail.link import keys as link_keys
from handrail.link import pairing
from handrail.robot import library as robots


class Antialiasing(StrEnum):
    """How smooth the 3-D view's edges are."""

    AUTO = "auto"
    OFF = "off"
    STILL = "still"
    ON = "on"


class Look(StrEnum):
    """The 3-D view's presets."""

    ROBOT = "robot"
    WORK = "work"
    FRONT = "front"
    SIDE = "side"
    TOP = "top"


def tablet(
    address: Annotated[
        str, typer.Option("--connect", metavar="ADDRESS", envvar="HANDRAIL_ADDRESS", help="The robot's link.")
    ] = DEFAULT_ADDRESS,
    operator: Annotated[str, typer.Option(help="Your name, as the robot's log shows it.")] = "operator",
    keys: Annotated[Path | None, typer.Option(help="Folder of keys, if not this user's own.")] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="The window's size in pixels.")] = "1280x800",
    fullscreen: Annotated[bool, typer.Option("--fullscreen", help="Fill the screen.")] = False,
    look: Annotated[Look, typer.Option(help="The view to start with.")] = Look.ROBOT,
    antialiasing: Annotated[
        Antialiasing,
        typer.Option(help="Smooth edges; still: when nothing moves; auto: on where there is a graphics processor."),
    ] = Antialiasing.AUTO,
    shot: Annotated[Path | None, typer.Option(metavar="PNG", help="Save a picture of the window, then exit.")] = None,
    after: Annotated[float, typer.Option(metavar="S", min=0.0, help="With --shot: seconds to wait first.")] = 5.0,
) -> None:
    """Open the operator's window. It waits for the robot, and finds it again when the link comes back.

    STOP: the button, Escape or Space, from anywhere in the window. Enter presses what has the focus, Tab moves it.
    One finger or the left button turns the view, two fingers or the right button move it, pinch or wheel zoom.
    """
    extent = _size(size)
    if shot is not None and not shot.parent.is_dir():
        raise typer.BadParameter(f"got {shot}; expected a file in a folder that exists", param_hint="--shot")
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        sys.exit(
            "handrail tablet: DISPLAY is not set: there is no screen; without one, run: xvfb-run -a handrail tablet"
        )
    try:
        own = link_keys.for_client(keys)
        connect(address, own, timeout_s=0).close()  # is the address one?
    except (link_keys.KeysError, ValueError) as problem:
        sys.exit(f"handrail tablet: {problem}")
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    raise typer.Exit(_run(address, own, operator, extent, fullscreen, look, antialiasing, shot, after))


def _run(
    address: str,
    own: link_keys.ClientKeys,
    operator: str,
    size: tuple[int, int],
    fullscreen: bool,
    look: Look,
    antialiasing: Antialiasing,
    shot: Path | None,
    after: float,
) -> int:
    from PySide6.QtCore import QTimer

    from tablet_client import tour_desk, window
    from tablet_client.line import Line

    smoothing = {
        Antialiasing.OFF: window.NO_ANTIALIASING,
        Antialiasing.STILL: window.WHEN_STILL,
        Antialiasing.ON: window.ALWAYS,
    }.get(antialiasing)
    app = window.application()
    opened = window.open_window(
        address, robots.load, mesh_cache(), size=size, look=look.value, antialiasing=smoothing, operator=operator
    )
    if fullscreen:
        opened.window.showFullScreen()
    if shot is None and not tour_desk.seen():
        tour: Any = opened.desk.tour  # to mypy a Qt property is no value
        tour.begin()
    line = Line(opened, operator, guarded=shot is None)
    line.turn_to(address, own)
    first_contact: Any = opened.desk.pairing  # to mypy a Qt property is no value
    first_contact.pair_with = lambda endpoint, code: pairing.pair(endpoint, code, own.folder, name=pairing.own_name())
    first_contact.paired.connect(lambda link: line.turn_to(link, link_keys.for_client(own.folder)))

    # Python sees a signal only when it runs: let it run now and then while Qt sleeps.
    signal.signal(signal.SIGINT, lambda *_: app.quit())
    signal.signal(signal.SIGTERM, lambda *_: app.quit())
    awake = QTimer(interval=200)
    awake.timeout.connect(lambda: None)
    awake.start()

    status = 0

    def save() -> None:
        nonlocal status
        opened.window.grabWindow()  # the first frame after a change of antialiasing still has the old one
        picture: Any = opened.window.grabWindow()
        if not picture.save(str(shot)):
            print(f"handrail tablet: can't write {shot}; expected a name that ends with .png", file=sys.stderr)
            status = 1
        app.quit()

    def smooth() -> None:
        opened.window.setProperty("smoothing", window.SUPERSAMPLED)
        QTimer.singleShot(300, save)

    if shot is not None:
        QTimer.singleShot(round(after * 1000), smooth)
    app.exec()
    line.close()
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
