"""What several tests use."""

import json
import os
from pathlib import Path

import pytest

from sim_bridge.scene import Scene, draw_episode, load_scene
from sim_bridge.world import World

ROOT = Path(__file__).resolve().parents[2]
SCENE_FILE = ROOT / "config" / "scenes" / "pick.json"


@pytest.fixture(scope="session")
def scene() -> Scene:
    """The scene that users run."""
    return load_scene(SCENE_FILE)


@pytest.fixture
def world(scene):
    """The world of seed 0, its clock running."""
    world = World(scene, draw_episode(scene, 0))
    world.moving = True
    yield world
    world.close()


@pytest.fixture
def scene_values() -> dict:
    """What stands in the scene file, to be spoiled."""
    return json.loads(SCENE_FILE.read_text(encoding="utf-8"))


@pytest.fixture
def instance_name(request) -> str:
    """A name of shared memory that no other test has."""
    return f"bridge-{os.getpid()}-{abs(hash(request.node.name)) % 10**6}"


@pytest.fixture
def ur_host(request) -> str:
    """An address of this machine that no other test listens at: a UR's ports are fixed."""
    number = os.getpid() * 1000 + abs(hash(request.node.name)) % 1000
    return f"127.{64 + number // 62500 % 128}.{1 + number // 250 % 250}.{1 + number % 250}"
