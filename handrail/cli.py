"""The command `handrail`. Thin: each verb is an entry point of the package that owns the work, imported when it is called."""

from __future__ import annotations

import sys
from importlib.metadata import entry_points

import typer

_HELP = """Supervised robot manipulation, from an operator's tablet to the joint's controller.

Start here:

  handrail demo                      the whole stack turns a valve, and a judge looks

  handrail up talos_upper --scene valve    start a simulated robot and leave it running

  handrail tablet                    the operator's window, on the robot that is up

  handrail stop                      stop the robot now (works when everything else hangs)
"""

_VERBS = {
    "up": "Start a robot's service: plant (if simulated), daemon, engine and link.",
    "top": "What the processes of the robot that is up use, how often they were started anew, and their last words.",
    "stop": "Operator stop over the local socket; --clear unlatches it.",
    "demo": "Turn a valve with the whole stack and judge it by the plant's ground truth.",
    "tablet": "Open the operator's window.",
    "shell": "An IPython prompt with the robot that is up in it.",
    "can": "The CAN bus: look at it, record, replay, disturb, bridge.",
    "daemon": "The control daemon: how long its loop's cycles take, and how late they are.",
    "hardware": "Every drive and device of the robot that is up: life, state, errors, versions.",
    "safety": "Which safety rule holds the robot that is up, why, and how to recover.",
    "controllers": "Controllers of the robot that is up: list, load, configure, switch and unload them while it runs.",
    "drives": "Drive families and their references; read and set the parameters of drives on the bus.",
    "robot": "Robots: list them, check one's model against plant and network; switch the power of the one that is up.",
    "enable": "Take the drives into operation: brakes open, and the robot holds where it is.",
    "disable": "Take the drives out of operation: brakes close.",
    "jog": "Move one joint: jog JOINT +5deg, or jog JOINT to 0.3.",
    "home": "Bring the robot that is up to one of its postures, planned clear of everything.",
    "program": "Check or run a program of the library.",
    "engine": "Run an engine on another machine than the robot, through its link.",
    "deploy": "Bring a program, with all that it needs, to an engine of the robot that is up.",
    "deployments": "Which code the robot's engines have, since when, by whom, and whether it is yours; the way back.",
    "watch": "Events of the robot that is up: which, which of their fields, how often.",
    "pair": "Let another machine's client in, by a code that the robot shows; or join the robot that shows one.",
    "plan": "Plans: list them, show one's figures, plot it, export it, make one.",
    "template": "Affordance templates: list, show, check, draw, begin, import, teach them; run one that is placed.",
    "instance": "Templates that are placed: list, place, move, edit, attach, hold them; undo what you did.",
    "node": "Process nodes: list, try, run them without an engine; start, watch, stop those of the robot that is up.",
    "learn": "What past runs of programs tell about success: list, report, forget.",
    "new": "Begin a workspace, a program, a node, a behaviour, a scene, a template or a controller of your own.",
    "behaviour": "Chains of actions: check a file, run it on the robot that is up.",
    "replay": "Drive the control loop from a recording and find the first command that is another one now.",
    "bench": "Run a benchmark against its peers.",
    "campaign": "Lay faults on a moving robot, hundreds of times, and judge what the plant did.",
}


def main() -> None:
    """Run `handrail`; exits with the verb's status."""
    verbs = {point.name: point for point in entry_points(group="handrail.verbs")}
    arguments = sys.argv[1:]
    app = typer.Typer(help=_HELP, no_args_is_help=True, rich_markup_mode="markdown", add_completion=False)
    asked = next((word for word in arguments if not word.startswith("-")), None)
    others = {name: "" for name in sorted(verbs) if name not in _VERBS}  # another package's verbs
    for name, short in (_VERBS | others).items():
        point = verbs.get(name)
        if point is None:
            continue
        if name != asked:
            # Listed without importing what it needs: help stays instant.
            app.command(name, help=short)(lambda: None)
            continue
        try:
            loaded = point.load()
        except ModuleNotFoundError as error:
            sys.exit(
                f"handrail {name} needs the package {error.name}: install handrail with the extra that has it "
                f"(robot, sim or tablet), e.g. pip install 'handrail[robot,sim,tablet]'"
            )
        if isinstance(loaded, typer.Typer):
            app.add_typer(loaded, name=name, help=short)
        else:
            app.command(name, context_settings=vars(loaded).get("context_settings"))(loaded)
    app()


if __name__ == "__main__":
    main()
