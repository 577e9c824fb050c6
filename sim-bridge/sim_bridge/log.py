"""The log of a run: `DIR/log.npz` (every step) and `DIR/bridge.json` (what the bridge knows).

`log.npz` is a compressed numpy archive. Row `k` is the state at `time_s[k]` and what acted on it
during the step that began then; N rows, J joints, everything in the base frame B:

| array                 | shape | what |
|-----------------------|-------|------|
| `time_s`              | N     | the scenario's clock [s]; 0 at the first command |
| `position_rad`        | N, J  | measured joint positions |
| `velocity_rad_s`      | N, J  | measured joint velocities |
| `position_cmd_rad`    | N, J  | commanded (integrated) joint positions; NaN while braked |
| `velocity_cmd_rad_s`  | N, J  | commanded (integrated) joint velocities; NaN while braked |
| `acceleration_cmd_rad_s2` | N, J | commanded joint accelerations; NaN while braked |
| `torque_n_m`          | N, J  | applied torque, clamped, with gravity; NaN while braked |
| `gravity_torque_n_m`  | N, J  | the command's gravity torque, clamped; NaN while braked |
| `object_position_m`   | N, 3  | centre of the box |
| `object_quaternion_wxyz` | N, 4 | orientation of the box |
| `sphere_position_m`   | N, 3  | centre of the sphere |
| `tool_position_m`     | N, 3  | tip of the tool, from the measured joint positions |
| `tool_quaternion_wxyz`| N, 4  | orientation of the tool, continuous sign |
| `gripper_state`       | N     | `GripperState`: 1 open, 2 holding |
| `command_mode`        | N     | `CommandMode` of the command obeyed; -1 while braked |
| `command_reason`      | N     | `Reason` of the command obeyed; -1 while braked |
| `life_cycle`          | N     | newest `LifeCycle` of the status; -1 before the first |
| `lateness_s`          | N     | how late the step began; 0 in lockstep |
| `contact_sphere`      | N     | 1 when the physics saw the arm or the tool touch the sphere |

`bridge.json`: `schema` ("tprmp-bridge/1"), `scene` (file), `seed`, `instance`, `mode` ("real
time" or "lockstep"), `physics_rate_hz`, `outcome` ("lifted", "timeout", "stopped",
"controller stopped", "controller lost", "failed"), `episode` (what the seed drew), `timing`,
`command_faults` (how many commands had each fault, see `guard`) and `result` (see `evaluate`).
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from pathlib import Path

import numpy as np

from sim_bridge import files
from sim_bridge.demonstrations import continuous_quaternions
from sim_bridge.errors import BridgeError
from sim_bridge.kinematics import Chain, forward
from sim_bridge.poses import Array, quaternion_from_rotation

SCHEMA = "tprmp-bridge/1"
LOG_FILE = "log.npz"
BRIDGE_FILE = "bridge.json"

Log = dict[str, Array]


class LogWriter:
    """Rows in memory that was allocated before the loop."""

    def __init__(self, rows_max: int, joint_count: int) -> None:
        self.rows = 0
        self.rows_max = rows_max
        columns = {
            "time_s": (),
            "position_rad": (joint_count,),
            "velocity_rad_s": (joint_count,),
            "position_cmd_rad": (joint_count,),
            "velocity_cmd_rad_s": (joint_count,),
            "acceleration_cmd_rad_s2": (joint_count,),
            "torque_n_m": (joint_count,),
            "gravity_torque_n_m": (joint_count,),
            "object_position_m": (3,),
            "object_quaternion_wxyz": (4,),
            "sphere_position_m": (3,),
            "lateness_s": (),
        }
        self.columns = {key: np.full((rows_max, *end), np.nan) for key, end in columns.items()}
        for key in ("gripper_state", "command_mode", "command_reason", "life_cycle"):
            # Whatever is on the wire, 32 bits without a sign, as it is.
            self.columns[key] = np.full(rows_max, -1, dtype=np.int64)
        self.columns["contact_sphere"] = np.zeros(rows_max, dtype=np.int16)

    def write(self, **values: object) -> None:
        """Writes into the current row; columns that are not named keep what they have."""
        for key, value in values.items():
            self.columns[key][self.rows] = value

    def next_row(self) -> None:
        """Ends the current row."""
        self.rows += 1
        assert self.rows < self.rows_max, "the log is longer than the time limit"

    def finish(self, chain: Chain) -> Log:
        """The rows that were written, with the tool's poses."""
        log = {key: column[: self.rows].copy() for key, column in self.columns.items()}
        x_be = forward(chain, log["position_rad"])
        log["tool_position_m"] = x_be[:, :3, 3].copy()
        quaternions = np.array([quaternion_from_rotation(x[:3, :3]) for x in x_be])
        log["tool_quaternion_wxyz"] = (
            continuous_quaternions(quaternions) if len(quaternions) else np.empty((0, 4))
        )
        return log


def check_folder(folder: Path, *, force: bool) -> None:
    """Makes the folder; raises `BridgeError` when `save` would not write into it."""
    files.make_folder(folder)
    for name in (LOG_FILE, BRIDGE_FILE):
        files.check(folder / name, force=force)


def save(folder: Path, log: Log, bridge: dict[str, object], *, force: bool) -> None:
    """Writes both files into `folder`."""
    check_folder(folder, force=force)
    archive = io.BytesIO()
    np.savez_compressed(archive, **log)
    files.write(folder / LOG_FILE, archive.getvalue(), force=force)
    text = json.dumps({"schema": SCHEMA, **bridge}, indent=1)
    files.write(folder / BRIDGE_FILE, text + "\n", force=force)


def load(folder: Path) -> tuple[Log, dict[str, object]]:
    """Reads both files; raises `BridgeError` when one is missing or of another kind."""
    try:
        with np.load(folder / LOG_FILE) as archive:
            log = {key: archive[key] for key in archive.files}
        bridge = json.loads((folder / BRIDGE_FILE).read_text(encoding="utf-8"))
    except (zipfile.BadZipFile, zlib.error, EOFError, UnicodeDecodeError) as error:
        raise BridgeError(
            f"{folder / LOG_FILE}: is damaged ({error}): repeat `sim-bridge run`"
        ) from error
    except (OSError, ValueError) as error:
        raise BridgeError(
            f"{folder}: expected {LOG_FILE} and {BRIDGE_FILE} of `sim-bridge run`: {error}"
        ) from error
    found = bridge.get("schema") if isinstance(bridge, dict) else None
    if found != SCHEMA:
        raise BridgeError(f'{folder / BRIDGE_FILE}: `schema`: expected "{SCHEMA}", found {found}')
    missing = set(LogWriter(1, 1).columns) - set(log)
    if missing:
        raise BridgeError(f"{folder / LOG_FILE}: arrays {sorted(missing)} are missing")
    return log, bridge
