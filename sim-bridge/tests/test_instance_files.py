"""Shared memory that is full, and files that are not this user's own."""

import os
import re
import subprocess
import sys

import pytest
from conftest import SCENE_FILE

from sim_bridge.errors import BridgeError
from sim_bridge.services import Instance, StatePublisherPorts

OTHER_USER = 54321

UNSHARE = ["unshare", "-m" if os.getuid() == 0 else "-rm", "sh", "-c"]
MOUNT = (
    "folder=/tmp/tprmp-$(id -u) && mkdir -p -m 700 $folder && "
    "mount -t tmpfs -o mode=700 tmpfs $folder && mount -t tmpfs -o size=8m tmpfs /dev/shm"
)


def in_small_memory(*command):
    """A command in a mount namespace of its own, with 8 MiB of shared memory; its result."""
    possible = subprocess.run([*UNSHARE, MOUNT], capture_output=True, text=True, check=False)
    if possible.returncode != 0:
        why = f"a small /dev/shm cannot be mounted: {possible.stderr}"
        assert os.environ.get("TPRMP_REQUIRE_REALTIME") != "1", why
        pytest.skip(why)
    return subprocess.run(
        [*UNSHARE, f'{MOUNT} && exec "$0" "$@"', *map(str, command)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


FILL = """
import os
def fill(leave):
    system = os.statvfs("/dev/shm")
    with open("/dev/shm/fill", "wb") as file:
        os.posix_fallocate(file.fileno(), 0, system.f_bavail * system.f_frsize - leave)
"""

STANDING_STILL = """
from sim_bridge.messages import ControllerStatus, JointCommand, RobotState, TaskFrames
from sim_bridge.services import BridgeError, Instance, StatePublisherPorts
from sim_bridge.wire import OBSERVER_BUFFER
instance = Instance("{name}")
with StatePublisherPorts(instance) as ports:
    node = instance.node()
    service = instance.service(node, "robot_state", RobotState)
    readers = [service.subscriber_builder().buffer_size(OBSERVER_BUFFER).create() for _ in range(2)]
    fill(0)
    for sequence in range(4 * OBSERVER_BUFFER):
        ports.publish(TaskFrames(sequence=sequence), RobotState(sequence=sequence))
    try:
        StatePublisherPorts(instance)
        raise SystemExit("it opened")
    except BridgeError as error:
        print(error)
    readers.clear()
    del service, node
print("published")
"""


def test_a_reader_that_stands_still_does_not_end_the_publisher_in_full_memory(instance_name):
    script = FILL + STANDING_STILL.replace("{name}", instance_name)
    result = in_small_memory(sys.executable, "-c", script)
    assert result.returncode == 0, result
    assert "/dev/shm has 0 bytes free, at least 4194304 are needed" in result.stdout
    assert result.stdout.endswith("published\n")


def test_full_memory_at_the_start_is_an_error_of_the_bridge(instance_name, tmp_path):
    arguments = ["run", "--scene", SCENE_FILE, "--seed", "0", "--out", tmp_path]
    code = FILL + "fill(1 << 20)\nfrom sim_bridge.__main__ import main\nraise SystemExit(main())"
    result = in_small_memory(sys.executable, "-c", code, *arguments, "--instance", instance_name)
    assert result.returncode == 2, result
    assert "/dev/shm has 1048576 bytes free" in result.stderr
    assert "Traceback" not in result.stderr
    assert not Instance(instance_name).files.folder.exists()


def is_refused(instance, path, expected):
    with pytest.raises(BridgeError, match=re.escape(f"`{path}` {expected}")):
        StatePublisherPorts(instance)
    assert os.path.lexists(path)


def test_folders_that_others_can_write_and_links_are_refused(instance_name, tmp_path):
    instance = Instance(instance_name)
    StatePublisherPorts(instance).close()
    folder = instance.files.folder
    folder.mkdir()
    folder.chmod(0o777)
    is_refused(instance, folder, "can be written by others (mode 777)")
    folder.chmod(0o700)
    file = folder / "file"
    file.touch()
    file.chmod(0o620)
    is_refused(instance, file, "can be written by others (mode 620)")
    file.unlink()
    folder.rmdir()
    folder.symlink_to(tmp_path)
    is_refused(instance, folder, "is a link or a file in place of a folder: remove it")
    folder.unlink()
    StatePublisherPorts(instance).close()
    assert not folder.exists()


def test_files_of_another_user_are_refused(instance_name):
    if os.getuid() != 0:
        pytest.skip("only root can give a file to another user")
    instance = Instance(instance_name)
    StatePublisherPorts(instance).close()
    folder = instance.files.folder
    folder.mkdir()
    os.chown(folder, OTHER_USER, -1)
    is_refused(instance, folder, f"belongs to user {OTHER_USER}, not to user 0")
    folder.rmdir()
