"""Code on its way through a real gate to an engine's store of releases."""

from __future__ import annotations

import functools
import random
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engines.releases.check import check
from engines.releases.closure import bundle_of
from engines.releases.store import KEPT, ReleaseStore
from handrail.bundles import manifest, pieces
from handrail.bundles.sending import Sender
from handrail.link import keys
from handrail.messages import (
    Deploy,
    Deployment,
    GetReleases,
    Piece,
    PutBundle,
    RollBack,
    RolledBack,
    StopNode,
)
from handrail.topics import RefusedError, Unreachable

PROGRAM = """title: Press

resources:
  arm: {{kind: arm}}
{filler}
states:
  pressing:
    do: behave
    with: {{behaviour: nudge, arm: arm}}
    transitions: [{{event: done.invoke.pressing, target: well}}, {{event: error.execution, target: badly}}]
  well: {{final: true, outcome: succeeded}}
  badly: {{final: true, outcome: failed, detail: "{detail}"}}
"""
BEHAVIOUR = """steps:
  - name: press
    motion: {type: CompliantMotion, translation: {along: [0, 0, -0.05]}}
"""


def filler(size: int) -> str:
    chosen = random.Random(7)
    words = ["reach", "turn", "valve", "wheel", "slowly", "then", "left", "0.25", "1.75", "until", "contact"]
    lines, length = [], 0
    while length < size:
        lines.append("# " + " ".join(chosen.choices(words, k=8)) + f" {chosen.random():.6f}\n")
        length += len(lines[-1])
    return "".join(lines)


class Desk:
    """A developer's workspace, the robot's gate, and the store of one engine behind it."""

    def __init__(self, stand, folder: Path, monkeypatch):
        self.stand, self.folder, self.monkeypatch = stand, folder, monkeypatch
        for kind in ("rtc_programs", "behaviours"):
            (folder / kind).mkdir()
        shutil.copy(
            Path(__file__).parents[2] / "rtc_programs" / "behaviours" / "press.yaml",
            folder / "behaviours" / "nudge.yaml",
        )
        self.edit()
        monkeypatch.setenv("HANDRAIL_WORKSPACE", str(folder))
        self.robot = SimpleNamespace(
            name="two",
            joints=["a", "b"],
            groups={"tool": ["a", "b"]},
            arms={"right": SimpleNamespace(tip="tip", joints=("a", "b"))},
        )
        self.engine = stand.engine()
        self.start()
        stand.daemon()
        stand.gate()
        self.client = stand.client()

    def start(self) -> None:
        """The engine, anew."""
        # The robot's own workspace is another one: what is not in the bundle is not there.
        self.store = ReleaseStore(self.stand.runtime.folder / "code", functools.partial(self._check, self.robot))
        put = self.engine.answers
        put[PutBundle] = lambda call: (self.store.take(call.pieces), self.store.put(call))[1]
        put[GetReleases] = lambda call: self.store.listing("engine")
        put[RollBack] = lambda call: RolledBack(release=self.store.roll_back(call))

    def _check(self, robot, folder, programs) -> None:
        with self.monkeypatch.context() as robots_machine:
            robots_machine.delenv("HANDRAIL_WORKSPACE")
            check(folder, programs, robot)

    def edit(self, detail: str = "it did not", size: int = 0) -> None:
        """Write the program."""
        text = PROGRAM.format(filler=filler(size), detail=detail)
        (self.folder / "rtc_programs" / "nudge.yaml").write_text(text)

    def sender(self, call=None) -> Sender:
        return Sender(call or self.client.call, "this robot", self.folder / "cache")

    def deploy(self, note: str = ""):
        return self.sender().send(bundle_of("nudge"), note=note)

    def runs(self) -> str:
        """The program in force."""
        return (self.store.folder / "rtc_programs" / "nudge.yaml").read_text()


@pytest.fixture
def desk(stand, tmp_path, monkeypatch) -> Desk:
    return Desk(stand, tmp_path, monkeypatch)


def test_a_one_line_edit_of_a_large_program_deploys_in_a_kilobyte(desk):
    desk.edit(size=100_000)
    desk.deploy()
    desk.edit(size=100_000, detail="it did not, once more")
    before = sum(desk.client.traffic)
    release = desk.deploy()
    crossed = sum(desk.client.traffic) - before
    assert release.changed == ["rtc_programs/nudge.yaml"]
    assert "once more" in desk.runs()
    assert crossed <= 1000, f"{crossed} bytes, both ways"


def test_a_program_travels_with_what_it_needs_and_only_that(desk):
    (desk.folder / "behaviours" / "other.yaml").write_text("steps: []")
    release = desk.deploy("first try")
    assert release.changed == ["behaviours/nudge.yaml", "rtc_programs/nudge.yaml"]
    assert (release.number, release.by, release.note) == (1, "local", "first try")


def test_the_same_bundle_again_is_no_new_release(desk):
    first, second = desk.deploy(), desk.deploy()
    assert (first.already, second.already) == (False, True)
    assert second.number == first.number == desk.client.releases().releases[-1].number


def test_a_bundle_that_is_cut_in_the_middle_leaves_the_old_one_and_goes_on_where_it_was(desk):
    desk.deploy()
    old = desk.runs()
    desk.edit(detail="new")
    files = {
        f"{kind}/nudge.yaml": (desk.folder / kind / "nudge.yaml").read_bytes()
        for kind in ("rtc_programs", "behaviours")
    }
    bundle = manifest.bundle("nudge", files | {"affordance_templates/wheel.obj": filler(300_000).encode()})
    sent: list[str] = []

    def sender_whose_third_call_is_lost() -> Sender:
        calls = iter(range(3))

        def call(message, timeout_s):
            sent.extend(piece.address for piece in message.pieces)
            if next(calls) == 2:
                raise Unreachable("the link broke")
            return desk.client.call(message, timeout_s)

        return desk.sender(call)

    cuts, release = 0, None
    while release is None and cuts < 10:
        assert desk.runs() == old
        try:
            release = sender_whose_third_call_is_lost().send(bundle)
        except Unreachable:
            cuts += 1
            desk.start()  # an engine that is killed meanwhile does not lose what has come either
    assert cuts >= 2
    assert release is not None and release.number == 2
    assert "new" in desk.runs()
    lost = len(sent) - len(set(sent))
    assert lost <= cuts * (1 + len(set(sent)) // 3), "what had come before a cut was sent again"


def test_an_unsound_program_is_refused_by_file_and_line_and_the_old_one_stays(desk):
    desk.deploy()
    bad = bundle_of("nudge")
    text = desk.runs().replace("target: well", "target: nowhere").encode()
    files = {
        "rtc_programs/nudge.yaml": text,
        "behaviours/nudge.yaml": (desk.folder / "behaviours/nudge.yaml").read_bytes(),
    }
    bad = manifest.bundle("nudge", files)
    with pytest.raises(RefusedError, match=r"rtc_programs/nudge.yaml:\d+: states.pressing.transitions\[0\].target"):
        desk.sender().send(bad)
    assert desk.store.listing("engine").releases[-1].number == 1
    assert "target: well" in desk.runs()


def test_what_the_robot_does_not_have_is_refused(desk):
    desk.robot.arms = {}
    with pytest.raises(RefusedError, match="needs an arm"):
        desk.deploy()
    assert desk.store.folder is None


def test_a_program_whose_parts_were_left_behind_is_refused(desk):
    alone = manifest.bundle(
        "nudge", {"rtc_programs/nudge.yaml": (desk.folder / "rtc_programs/nudge.yaml").read_bytes()}
    )
    with pytest.raises(RefusedError, match="behaviour: no such behaviour"):
        desk.sender().send(alone)


@pytest.mark.parametrize(
    "path", ["../evil.py", "/etc/evil", "nodes/../../evil.py", "elsewhere/a.py", "nodes/.ssh", "nodes"]
)
def test_a_path_that_leads_out_of_the_workspace_is_refused(desk, path):
    with pytest.raises(RefusedError, match="not a bundle"):
        desk.sender().send(manifest.bundle("nudge", {path: b"print()"}))


def test_damaged_pieces_are_refused(desk):
    listed = bundle_of("nudge").manifest.encoded()
    other = Piece(address=pieces.address(listed), data=pieces.pack(b"other"))
    spoiled = Piece(address=pieces.address(listed), data=pieces.pack(listed)[:-3])
    for piece, why in ((other, "not what its address says"), (spoiled, "came damaged")):
        with pytest.raises(RefusedError, match=why):
            desk.client.call(PutBundle(bundle=piece.address, pieces=[piece]))


def test_only_developers_keys_may_bring_code_and_operators_may_run_it(desk, tmp_path):
    release = desk.deploy()
    desk.engine.answers[Deploy] = lambda call: Deployment(id="1", program=call.program, hash="0")
    folder = tmp_path / "tablet"
    keys.ensure(folder)
    shutil.copy(desk.stand.keys / "server.key", folder / "server.key")
    allowed = desk.stand.keys / "allowed"
    shutil.copy(folder / "client.key", allowed / "ann.key")
    ann = desk.stand.client(folder)
    desk.edit("by ann")
    for attempt in (
        lambda: Sender(ann.call, "r", tmp_path / "c").send(bundle_of("nudge")),
        ann.roll_back,
        lambda: ann.reload_node("low_pass"),
    ):
        with pytest.raises(RefusedError) as refused:
            attempt()
        refusal = refused.value.refusal
        assert (refusal.field, refusal.value, refusal.expected) == ("role", "operator", "developer")
        assert "ann" in refusal.message
        assert keys.for_client(folder).public.decode() in refusal.message
    assert desk.store.listing("engine").releases == [release]
    assert ann.deploy("nudge", {"arm": "right"}).program == "nudge"
    assert ann.releases().releases == [release]
    desk.engine.answers[StopNode] = lambda call: None
    ann.stop_node("low_pass")

    (allowed / "developers").mkdir()
    (allowed / "ann.key").rename(allowed / "developers" / "ann.key")
    assert Sender(ann.call, "r", tmp_path / "c").send(bundle_of("nudge")).by == "ann"

    (allowed / "developers" / "ann.key").unlink()
    with pytest.raises(RefusedError, match="not allowed in any more"):
        ann.roll_back()


def test_nobody_can_deploy_in_another_ones_name(desk):
    bundle = bundle_of("nudge")
    parts = [Piece(address=address, data=pieces.pack(content)) for address, content in bundle.contents.items()]
    assert desk.client.call(PutBundle(bundle=bundle.address, pieces=parts, by="somebody")).release.by == "local"


def test_any_of_the_last_releases_comes_back_whole(desk):
    for number in range(4):
        desk.edit(f"version {number}")
        desk.deploy()
    back = desk.client.roll_back(2)
    assert (back.number, back.note, back.changed) == (5, "back to release 2", ["rtc_programs/nudge.yaml"])
    assert "version 1" in desk.runs()
    assert desk.client.roll_back().number == 6
    assert "version 3" in desk.runs()
    with pytest.raises(RefusedError, match="one of: 1, 2, 3, 4, 5"):
        desk.client.roll_back(17)


def test_an_engine_that_starts_anew_has_what_was_in_force_whatever_became_of_its_files(desk):
    desk.deploy()
    desk.edit("second")
    desk.deploy()
    (desk.stand.runtime.folder / "code" / "3.new").mkdir()  # killed while it wrote a release
    (desk.stand.runtime.folder / "code" / "3").mkdir()
    (desk.store.folder / "rtc_programs" / "nudge.yaml").write_text("spoiled")
    desk.start()
    assert "second" in desk.runs()
    desk.edit("third")
    assert desk.deploy().number == 3
    assert "third" in desk.runs()


def test_only_the_last_releases_are_kept_with_their_pieces(tmp_path):
    store = ReleaseStore(tmp_path, lambda folder, programs: None, limit=250)
    for number in range(KEPT + 6):
        bundle = manifest.bundle("nudge", {"rtc_programs/nudge.yaml": b"version %d" % number})
        store.take([Piece(address=address, data=pieces.pack(content)) for address, content in bundle.contents.items()])
        store.put(PutBundle(bundle=bundle.address))
    kept = [f"version {number}" for number in range(6, KEPT + 6)]
    assert sorted(int(folder.name) for folder in tmp_path.iterdir() if folder.name.isdigit()) == list(
        range(7, KEPT + 7)
    )
    contents = [file.read_bytes() for file in (tmp_path / "pieces").iterdir()]
    texts = {text.decode() for text in contents if text.startswith(b"version")}
    assert texts >= set(kept)
    assert len(texts) <= KEPT + 250 // 90


def test_pieces_that_nothing_needs_go_when_there_are_too_many(tmp_path):
    store = pieces.PieceStore(tmp_path, 1000)
    kept = store.put(b"k" * 2000)
    others = [store.put(bytes([number]) * 1000) for number in range(4)]
    store.collect({kept})
    assert store.get(kept)
    assert [store.get(each) is not None for each in others] == [False, False, False, True]


def test_a_piece_that_the_disk_has_spoiled_is_none(tmp_path):
    store = pieces.PieceStore(tmp_path, 3000)
    name = store.put(b"content")
    (tmp_path / name).write_bytes(b"c0ntent")
    assert store.get(name) is None
    assert store.lacks([name]) == [name]


@settings(max_examples=30, deadline=None)
@given(st.binary(max_size=300), st.integers(1, 400), st.integers(0, 10**9), st.binary(max_size=40))
def test_pieces_are_the_file_and_an_edit_changes_few_of_them(line, count, place, new):
    content = b"".join(line + b"%d\n" % number for number in range(count))
    parts = pieces.cut(content)
    assert b"".join(parts) == content
    assert max(map(len, parts)) <= pieces.LARGEST
    at = place % (len(content) + 1)
    edited = pieces.cut(content[:at] + new + content[at:])
    assert b"".join(edited) == content[:at] + new + content[at:]
    assert all(pieces.unpack(pieces.pack(part, parts[0]), parts[0]) == part for part in edited)
