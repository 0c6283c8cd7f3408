"""Keys of the link: made once, whole, for this user only."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

from handrail.link import keys


def test_the_first_run_makes_a_pair_for_each_side_and_lets_this_user_in(tmp_path):
    folder = tmp_path / "keys"
    client, gate = keys.for_client(folder), keys.for_gate(folder)
    assert client.server == gate.public
    assert gate.name_of(client.public) == "local"
    assert gate.name_of(gate.public) is None


def test_secrets_are_readable_by_their_owner_only(tmp_path):
    folder = keys.ensure(tmp_path / "keys")
    assert folder.stat().st_mode & 0o077 == 0
    for name in ("server", "client"):
        assert (folder / f"{name}.key_secret").stat().st_mode & 0o077 == 0


def test_later_runs_keep_them(tmp_path):
    first = keys.for_client(tmp_path / "keys")
    assert keys.for_client(tmp_path / "keys") == first


def test_processes_that_start_at_once_agree_on_them(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        pairs = list(pool.map(lambda _: keys.for_client(tmp_path / "keys"), range(8)))
    assert len({pair.public for pair in pairs}) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["keys"]


def test_are_found_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDRAIL_KEYS", str(tmp_path / "here"))
    assert keys.default_folder() == tmp_path / "here"
    monkeypatch.delenv("HANDRAIL_KEYS")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    assert keys.default_folder() == tmp_path / "config" / "handrail" / "keys"


def test_a_client_needs_neither_the_robots_secret_nor_its_list(tmp_path):
    robot, tablet = keys.ensure(tmp_path / "robot"), tmp_path / "tablet"
    tablet.mkdir()
    for name in ("client.key", "client.key_secret", "server.key"):
        shutil.copy(robot / name, tablet / name)
    assert keys.for_client(tablet).server == keys.for_gate(robot).public


def test_a_missing_key_is_named_with_what_to_do(tmp_path):
    folder = keys.ensure(tmp_path / "keys")
    (folder / "server.key").unlink()
    with pytest.raises(keys.KeysError, match=r"server\.key: no key there.*copy it"):
        keys.for_client(folder)


def test_a_public_certificate_is_no_secret(tmp_path):
    folder = keys.ensure(tmp_path / "keys")
    shutil.copy(folder / "client.key", folder / "client.key_secret")
    with pytest.raises(keys.KeysError, match="holds no secret key"):
        keys.for_client(folder)


def test_a_file_in_the_allowed_folder_that_is_no_key_lets_nobody_in(tmp_path):
    gate = keys.for_gate(tmp_path / "keys")
    (gate.allowed / "broken.key").write_text("curve\n")
    assert gate.name_of(keys.for_client(tmp_path / "keys").public) == "local"


def test_secrets_do_not_show_when_printed(tmp_path):
    client = keys.for_client(tmp_path / "keys")
    assert client.secret.decode() not in repr(client)
