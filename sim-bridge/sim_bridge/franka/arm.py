"""The arm behind libfranka: connecting, states, and commands within a millisecond."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

from sim_bridge.errors import BridgeError
from sim_bridge.franka.limits import JOINTS
from sim_bridge.messages import RobotMode

VERSION = "0.21.3"
COLLISION_TORQUE_N_M = (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
COLLISION_FORCE_N = (20.0, 20.0, 20.0, 25.0, 25.0, 25.0)
"""Beyond these external torques [N m], and forces and torques of the tool [N] and [N m], the arm
stops by a reflex; those of libfranka's examples."""
RECOVERY_STATES_MAX = 1000
"""How many states a confirmed reflex may still be reported in: a second of them."""
GRAVITY_M_S2 = (0.0, 0.0, -9.81)


def bindings() -> ModuleType:
    """pylibfranka; raises `BridgeError` with the command that installs it."""
    try:
        import pylibfranka
    except ImportError as error:
        raise BridgeError(
            f"pylibfranka cannot be loaded ({error}): `python -m pip install "
            f"pylibfranka=={VERSION}` installs it; `make venv-franka` sets up "
            "target/venv-franka, which has it"
        ) from error
    return pylibfranka


class Arm:
    """A connection to the arm. Its states are libfranka's own `RobotState`."""

    def __init__(self, address: str, *, enforce_real_time: bool) -> None:
        self.bindings = bindings()
        config = self.bindings.RealtimeConfig
        try:
            self.robot = self.bindings.Robot(
                address, config.kEnforce if enforce_real_time else config.kIgnore
            )
            self.model = self.robot.load_model()
        except (RuntimeError, self.bindings.FrankaException) as error:
            raise BridgeError(
                f"the arm at {address} cannot be reached ({error}): check the address, that its "
                "brakes are open and FCI is active in Desk, and with --real-time enforce that the "
                "kernel is a real-time one"
            ) from error
        self._control = None
        self._torques = True
        modes = self.bindings.RobotMode
        self._modes = {
            int(modes.Idle): RobotMode.RUNNING,
            int(modes.Move): RobotMode.RUNNING,
            int(modes.Guiding): RobotMode.HAND_GUIDING,
            int(modes.Reflex): RobotMode.PROTECTIVE_STOP,
            int(modes.AutomaticErrorRecovery): RobotMode.PROTECTIVE_STOP,
            int(modes.UserStopped): RobotMode.EMERGENCY_STOP,
        }

    def mode(self, state: object) -> RobotMode:
        """What the arm itself is doing."""
        mode = self._modes.get(int(state.robot_mode), RobotMode.FAULT)
        if mode == RobotMode.RUNNING and state.current_errors:
            return RobotMode.PROTECTIVE_STOP
        return mode

    def torque(self, state: object) -> list[float]:
        """Measured torques without what holds the arm against gravity [N m]."""
        if not any(state.O_ddP_O):
            # A robot that does not say how it is mounted stands upright.
            state.O_ddP_O = GRAVITY_M_S2
        return [t - g for t, g in zip(state.tau_J, self.model.gravity(state))]

    def start(self, interface: str, *, recover: bool) -> object:
        """Begins to control the arm and gives the state from which it does.

        Raises `BridgeError` where it may not be moved.
        """
        state = self.robot.read_once()
        if recover and self.mode(state) == RobotMode.PROTECTIVE_STOP:
            self._ask(self.robot.automatic_error_recovery)
            # States from before may still be on their way.
            for _ in range(RECOVERY_STATES_MAX):
                state = self.robot.read_once()
                if self.mode(state) == RobotMode.RUNNING:
                    break
        mode = self.mode(state)
        if mode != RobotMode.RUNNING:
            raise BridgeError(
                f"the arm may not be moved: expected the mode Idle, found {state.robot_mode.name} "
                f"with the errors {state.current_errors}: look at the arm; --recover confirms a "
                "reflex, the enabling device ends a user stop"
            )
        torque, force = list(COLLISION_TORQUE_N_M), list(COLLISION_FORCE_N)
        self._ask(self.robot.set_collision_behavior, torque, torque, force, force)
        self._torques = interface == "torque"
        if self._torques:
            self._control = self._ask(self.robot.start_torque_control)
        else:
            mode = self.bindings.ControllerMode.JointImpedance
            self._control = self._ask(self.robot.start_joint_position_control, mode)
        return state

    def _ask(self, what: object, *arguments: object) -> object:
        try:
            return what(*arguments)
        except (RuntimeError, self.bindings.FrankaException) as error:
            raise BridgeError(f"the arm refuses `{what.__name__}`: {error}") from error

    def read(self) -> tuple[object, float]:
        """The next state, and the robot's time since the one before [s]."""
        state, period = self._control.readOnce()
        return state, period.to_sec()

    def look(self) -> object:
        """The next state of an arm that is not controlled."""
        return self.robot.read_once()

    def write(self, numbers: Sequence[float], *, finished: bool = False) -> None:
        """Answers the state read last by torques [N m] or positions [rad]."""
        assert len(numbers) == JOINTS, numbers
        kind = self.bindings.Torques if self._torques else self.bindings.JointPositions
        command = kind(list(numbers))
        command.motion_finished = finished
        self._control.writeOnce(command)
