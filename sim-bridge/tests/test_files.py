"""Files written whole, names that come out of files, and readers that have gone."""

import os
import resource
import signal
import socket
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT, SCENE_FILE

from sim_bridge import cli, files, log, record
from sim_bridge.demonstrations import read_demonstration
from sim_bridge.errors import BridgeError
from sim_bridge.fit import fit
from sim_bridge.instance_files import SHARED_MEMORY
from sim_bridge.scene import load_scene
from sim_bridge.services import Instance

NO_NAMES = (
    *("", ".", "..", "../../evil", "/etc/passwd", "a/b", "a\\b", ".hidden", "-rf", " a", "a "),
    *("a\n", "a\0b", "\x1b[2J", "\u202egnp", "a\u2028b", "\ud800", "x" * 101, 7, None),
)


def names(folder):
    return sorted(file.name for file in folder.iterdir())


def test_a_file_is_replaced_whole_by_force_only_and_keeps_its_permissions(tmp_path):
    file = tmp_path / "log.npz"
    files.write(file, "first", force=False)
    with pytest.raises(BridgeError, match=r"log\.npz: is there already .* --force"):
        files.write(file, "x", force=False)
    file.chmod(0o604)
    with file.open() as reader:
        files.write(file, b"second", force=True)
        assert reader.read() == "first", "who reads meets the old one, whole"
    assert file.read_text() == "second"
    assert stat.S_IMODE(file.stat().st_mode) == 0o604
    assert names(tmp_path) == ["log.npz"]


def test_devices_pipes_sockets_and_folders_stay_what_they_are(tmp_path):
    kinds = {"pipe": "a pipe", "folder": "a folder", "socket": "a socket"}
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(tmp_path / "socket"))
    try:
        os.mknod(tmp_path / "device", stat.S_IFCHR | 0o600, os.makedev(1, 3))
        kinds["device"] = "a device"
    except PermissionError:
        pass
    for name, kind in kinds.items():
        before = stat.S_IFMT((tmp_path / name).stat().st_mode)
        with pytest.raises(BridgeError, match=f"cannot be written: it is {kind}; name a file"):
            files.write(tmp_path / name, "x", force=True)
        assert stat.S_IFMT((tmp_path / name).stat().st_mode) == before
    listener.close()


def test_a_link_stays_and_its_target_is_written(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    link = tmp_path / "link"
    link.symlink_to("elsewhere/log.npz")
    for content in ("of a new file", "of one that is there"):
        files.write(link, content, force=True)
        assert (tmp_path / "elsewhere" / "log.npz").read_text() == content
        assert os.readlink(link) == "elsewhere/log.npz"
    assert names(tmp_path / "elsewhere") == ["log.npz"]


def test_a_full_disk_leaves_what_was_there(tmp_path):
    file = tmp_path / "log.npz"
    files.write(file, "before", force=False)
    limit, ignored = resource.getrlimit(resource.RLIMIT_FSIZE), signal.SIGXFSZ
    before = signal.signal(ignored, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))
        with pytest.raises(BridgeError, match="cannot be written: File too large"):
            files.write(file, b"x" * 2000, force=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(ignored, before)
    assert file.read_text() == "before"
    assert names(tmp_path) == ["log.npz"]


@pytest.mark.parametrize("text", NO_NAMES)
def test_what_would_be_a_path_or_move_a_cursor_is_no_name(text):
    assert not files.is_name(text)


@pytest.mark.parametrize("text", ["pick", "two-loops", "Zug um Zug", "größer", "日本", "a..b"])
def test_a_name_is_one(text):
    assert files.is_name(text)
    assert files.printable(text) == text


def test_control_characters_are_escaped():
    assert files.printable("\x1b[2J\tü\r\n\u202e") == "\\x1b[2J\\tü\\r\n\\u202e"


@pytest.mark.parametrize("bad", ["../evil", "\\u001b[2J"])
def test_names_of_scenes_and_demonstrations_are_names(tmp_path, bad):
    text = SCENE_FILE.read_text(encoding="utf-8")
    scene = tmp_path / "scene.json"
    for key in ("skill", "goal_frame"):
        start = text.index(f'"{key}": "') + len(f'"{key}": "')
        spoilt = text[:start] + bad + text[text.index('"', start) :]
        scene.write_text(spoilt, encoding="utf-8")
        with pytest.raises(BridgeError, match=rf"scene\.json: `task\.{key}`: expected a name"):
            load_scene(scene)
    recorded = next((ROOT / "config" / "demonstrations" / "pick").glob("*.json"))
    text = recorded.read_text(encoding="utf-8")
    file = tmp_path / "01.json"
    for key, found in (("skill", '"pick"'), ("frames", '"object"')):
        assert found in text
        file.write_text(text.replace(found, f'"{bad}"', 1), encoding="utf-8")
        with pytest.raises(BridgeError, match=rf"01\.json: `{key}`: expected a name of 1 to 100"):
            read_demonstration(file)


def test_a_fitting_stays_inside_the_package(tmp_path):
    text = (ROOT / "config" / "robots" / "panda_suction.json").read_text(encoding="utf-8")
    start = text.index('"package_urdf": "') + len('"package_urdf": "')
    for bad in ("../../evil.urdf", "/etc/passwd"):
        file = tmp_path / "fitting.json"
        spoilt = text[:start] + bad + text[text.index('"', start) :]
        file.write_text(spoilt, encoding="utf-8")
        with pytest.raises(BridgeError, match="`package_urdf`: expected a path inside"):
            fit(file, tmp_path / "out.urdf")


def test_another_run_stays_without_force(tmp_path, scene, monkeypatch, capsys):
    theirs = tmp_path / log.LOG_FILE
    theirs.write_bytes(b"theirs")
    arguments = ["run", "--scene", str(SCENE_FILE), "--seed", "0", "--out", str(tmp_path)]
    assert cli.main(arguments) == 2
    assert f"{theirs}: is there already" in capsys.readouterr().err
    (tmp_path / "02.json").write_text("theirs")
    monkeypatch.setattr(record, "record_one", None)
    with pytest.raises(BridgeError, match=r"02\.json: is there already"):
        record.record(scene, tmp_path, 2, 0, force=False)
    assert names(tmp_path) == ["02.json", log.LOG_FILE]


def start(*arguments, **streams):
    return subprocess.Popen(
        [sys.executable, "-m", "sim_bridge", *arguments], cwd=ROOT, text=True, **streams
    )


def test_a_reader_that_has_gone_is_no_reason_to_fail(tmp_path):
    out = tmp_path / "demonstrations"
    reader, writer = os.pipe()
    os.close(reader)
    arguments = ("record", "--scene", SCENE_FILE, "--count", "1", "--out", out)
    process = start(*arguments, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    _, error = process.communicate(timeout=120)
    assert (process.returncode, error) == (0, "")
    assert names(out) == ["01.json"]


def test_an_output_without_room_is_told(tmp_path):
    with Path("/dev/full").open("w") as full:
        process = start("--help", stdout=full, stderr=subprocess.PIPE)
        _, error = process.communicate(timeout=60)
    assert "Traceback" not in error
    arguments = ("record", "--scene", SCENE_FILE, "--count", "1", "--out", tmp_path / "out")
    with Path("/dev/full").open("w") as full:
        process = start(*arguments, stdout=full, stderr=subprocess.PIPE)
        _, error = process.communicate(timeout=120)
    assert process.returncode == 2
    assert error == "sim-bridge: standard output cannot be written: No space left on device\n"
    assert names(tmp_path / "out") == ["01.json"]


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_at_once_are_one_and_leave_nothing(tmp_path, instance_name, first):
    arguments = ("run", "--scene", SCENE_FILE, "--seed", "0", "--out", tmp_path)
    process = start(*arguments, "--instance", instance_name, stdout=subprocess.PIPE)
    assert "waiting for a controller" in process.stdout.readline()
    for number in (first, signal.SIGTERM, signal.SIGINT):
        process.send_signal(number)
    out, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    assert "outcome: stopped before a first command" in out
    assert list(SHARED_MEMORY.glob(f"{Instance(instance_name).files.prefix}*")) == []


STUBBORN = """
import time
from sim_bridge.services import StopSignal
with StopSignal() as stop:
    print("ready", flush=True)
    while not stop.requested:
        time.sleep(0.001)
    print("stop", flush=True)
    time.sleep(600.0)
"""


def test_a_later_signal_leaves_at_once():
    process = subprocess.Popen(
        [sys.executable, "-c", STUBBORN], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGHUP)
    assert process.stdout.readline() == "stop\n"
    # As by somebody at a keyboard, who presses Ctrl-C until it helps.
    while process.poll() is None:
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
    assert process.returncode == 128 + signal.SIGINT
    process.stdout.close()
