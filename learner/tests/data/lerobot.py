"""Makes the LeRobot data set that tests/import_robots.rs reads, as LeRobot 3 lays it out and pyarrow writes it.

    python lerobot.py    # needs pyarrow; writes lerobot/ beside this file

Three episodes of a UR5 that rotates its joints smoothly and closes a gripper in the middle. The state is a list
of fixed length, as `datasets` writes it; the second file has lists of any length, which other writers make.
"""

import json
import math
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

ROOT = Path(__file__).with_name("lerobot")
FPS = 20
LENGTHS = [31, 25, 28]
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
STATE = [f"{joint}.pos" for joint in JOINTS] + ["gripper.pos"]
START = [-2.4, -1.2, 1.4, -1.6, -1.5, 0.2]
OBJECT = ["x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"]


def state(episode, i, count):
    """The joints [rad] and the gripper, 1 open and 0 closed."""
    s = i / (count - 1)
    bow = s * s * (3 - 2 * s)
    joints = [q + (0.3 + 0.05 * episode) * bow * math.cos(k) for k, q in enumerate(START)]
    return [*joints, 1.0 if s < 0.5 else 0.1]


def columns(episode, first):
    """The columns of an episode whose first row has the index `first`."""
    count = LENGTHS[episode]
    place = [0.3 + 0.1 * episode, -0.2, 0.05, math.cos(0.2), 0.0, 0.0, math.sin(0.2)]
    return {
        "observation.state": [state(episode, i, count) for i in range(count)],
        "observation.object": [place] * count,
        "action": [[0.0] * len(STATE)] * count,
        "timestamp": [i / FPS for i in range(count)],
        "frame_index": list(range(count)),
        "episode_index": [episode] * count,
        "index": list(range(first, first + count)),
        "task_index": [0] * count,
    }


def types(fixed):
    """Types of the columns."""
    size = {"observation.state": 7, "observation.object": 7, "action": 7}
    lists = {key: pa.list_(pa.float32(), n if fixed else -1) for key, n in size.items()}
    whole = dict.fromkeys(["frame_index", "episode_index", "index", "task_index"], pa.int64())
    return lists | {"timestamp": pa.float32()} | whole


def write(path, rows, kinds=None):
    """A file of these columns."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if kinds:
        rows = {key: pa.array(rows[key], kinds[key]) for key in rows}
    pq.write_table(pa.table(rows), path, compression="snappy", use_dictionary=True)


def main():
    """Writes all files."""
    firsts = [sum(LENGTHS[:i]) for i in range(len(LENGTHS))]
    episodes = [columns(i, first) for i, first in enumerate(firsts)]
    both = {key: episodes[0][key] + episodes[1][key] for key in episodes[0]}
    write(ROOT / "data/chunk-000/file-000.parquet", both, types(fixed=True))
    write(ROOT / "data/chunk-000/file-001.parquet", episodes[2], types(fixed=False))
    write(ROOT / "meta/tasks.parquet", {"task_index": [0], "task": ["pick"]})
    meta = {
        "episode_index": list(range(len(LENGTHS))),
        "tasks": [["pick"]] * len(LENGTHS),
        "length": LENGTHS,
        "data/chunk_index": [0, 0, 0],
        "data/file_index": [0, 0, 1],
        "dataset_from_index": firsts,
        "dataset_to_index": [a + b for a, b in zip(firsts, LENGTHS, strict=True)],
    }
    write(ROOT / "meta/episodes/chunk-000/file-000.parquet", meta)
    scalar = {"shape": [1], "names": None}
    features = {
        "observation.state": {"dtype": "float32", "shape": [7], "names": STATE},
        "observation.object": {"dtype": "float32", "shape": [7], "names": {"axes": OBJECT}},
        "observation.images.front": {"dtype": "video", "shape": [48, 64, 3], "names": ["height", "width", "channels"]},
        "action": {"dtype": "float32", "shape": [7], "names": STATE},
        "timestamp": {"dtype": "float32"} | scalar,
    }
    for key in ["frame_index", "episode_index", "index", "task_index"]:
        features[key] = {"dtype": "int64"} | scalar
    info = {
        "codebase_version": "v3.0",
        "robot_type": "ur5",
        "total_episodes": len(LENGTHS),
        "total_frames": sum(LENGTHS),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": FPS,
        "splits": {"train": f"0:{len(LENGTHS)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": features,
    }
    (ROOT / "meta/info.json").write_text(json.dumps(info, indent=4) + "\n")


if __name__ == "__main__":
    main()
