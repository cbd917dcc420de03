"""Universal Robots through ur_rtde's receive, control and dashboard clients (RTDE version 2)."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from dashboard_client import DashboardClient
from rtde_control import RTDEControlInterface
from rtde_receive import RTDEReceiveInterface

from dlolib.errors import MotionRefused
from dlolib.execute.limits import LOOKAHEAD_S
from dlolib.execute.recorded import RECORDED
from dlolib.execute.robots.base import RobotKind
from dlolib.types import Floats

DASHBOARD_PORT = 29999
PORTS = {30004: "RTDE", DASHBOARD_PORT: "dashboard", 30003: "script"}
ANSWER_S = 3.0
STALE_S = 0.25
WATCHDOG_HZ = 2.0
GAIN = 300.0
ARRIVED_M_S2 = 1.0
CB3_RATE_HZ, E_RATE_HZ = 125.0, 500.0
RUNNING, PLAYING = 7, 2
SAFETY = {
    3: "protective stop",
    4: "recovery mode",
    5: "safeguard stop",
    6: "emergency stop of the system",
    7: "emergency stop of the robot",
    8: "safety violation",
    9: "safety fault",
}
MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirm safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle, brakes on",
    6: "backdrive",
    8: "updating firmware",
}
"""robot_mode and safety_mode of RTDE's guide."""


class UrRobot:
    """A `Robot` behind ur_rtde. Build it with `ur_robot`."""

    def __init__(self, host: str, dashboard: DashboardClient) -> None:
        self.host = host
        self._dashboard = dashboard
        major = int(dashboard.polyscopeVersion().split(".")[0])
        rate_hz = E_RATE_HZ if major > 3 else CB3_RATE_HZ
        self.period_s = 1 / rate_hz
        self._receive = RTDEReceiveInterface(host, rate_hz, [*RECORDED, "safety_status_bits"])
        self._control: RTDEControlInterface | None = None
        self._lost: str | None = None
        self._recording = self._approaching = self._servoing = self._ended = False
        self._seen_s, self._seen_at = -1.0, time.monotonic()

    def pose(self) -> Floats:
        return np.array(self._receive.getActualTCPPose(), dtype=np.float64)

    def clock_s(self) -> float:
        return float(self._receive.getTimestamp())

    def trouble(self) -> str | None:
        if self._lost is None:
            self._lost = self._silence()
        if self._lost is not None:
            return f"connection lost: {self._lost}"
        safety = int(self._receive.getSafetyMode())
        if safety in SAFETY:
            return SAFETY[safety]
        if self._receive.isProtectiveStopped() or self._receive.isEmergencyStopped():
            return "protective stop" if self._receive.isProtectiveStopped() else "emergency stop"
        mode = int(self._receive.getRobotMode())
        if mode != RUNNING:
            return f"the robot is not running ({MODES.get(mode, f'mode {mode}')})"
        if self._control is not None and int(self._receive.getRuntimeState()) != PLAYING:
            return "the control program ended or was paused on the controller"
        return None

    def _silence(self) -> str | None:
        """Why nothing comes from the robot any more, or None: a pulled cable closes no socket."""
        control = self._control
        if not self._receive.isConnected() or (control is not None and not control.isConnected()):
            return "the robot closed it"
        now, clock = time.monotonic(), self.clock_s()
        if clock != self._seen_s:
            self._seen_s, self._seen_at = clock, now
        silent = now - self._seen_at
        return f"no new sample for {silent:.2f} s" if silent > STALE_S else None

    def arm(self) -> None:
        try:
            self._control = RTDEControlInterface(self.host, 1 / self.period_s)
        except RuntimeError as error:
            mend = "enable remote control on the pendant and see that no field bus holds the input registers"
            raise MotionRefused(f"the robot at {self.host} takes no commands: {error}", mend=mend) from error

    def answers(self) -> bool:
        return bool(self._armed().isPoseWithinSafetyLimits(self.pose().tolist()))

    def forbids(self, poses: Floats) -> tuple[int, str] | None:
        control = self._armed()
        for row, pose in enumerate(poses):
            if not control.isPoseWithinSafetyLimits(pose.tolist()):
                return row, "the robot's own safety limits or kinematics"
        return None

    def joints(self, pose: Floats, near: Floats | None) -> Floats:
        """Joint angles [rad], shape (6,), of the controller's inverse kinematics nearest to `near`."""
        start = self._receive.getActualQ() if near is None else near.tolist()
        return np.array(self._armed().getInverseKinematics(pose.tolist(), start), dtype=np.float64)

    def record(self, raw: Path) -> None:
        self._receive.startFileRecording(str(raw), list(RECORDED))
        self._recording = True

    def stop_recording(self) -> None:
        if self._recording:
            self._receive.stopFileRecording()
            self._recording = False

    def approach(self, pose: Floats, speed_m_s: float, acceleration_m_s2: float) -> bool:
        # Without us the controller ends its program after half a second, and with it any motion.
        control, self._approaching = self._armed(), True
        return self._send(lambda: control.setWatchdog(WATCHDOG_HZ)) and self._send(
            lambda: control.moveL(pose.tolist(), speed_m_s, acceleration_m_s2, True)
        )

    def keep_alive(self) -> bool:
        return self._send(self._armed().kickWatchdog)

    def servo(self, pose: Floats) -> bool:
        control = self._armed()
        began = control.initPeriod()
        if self._approaching:
            # Ends the controller's thread of the approach: two threads may not move the arm.
            self._send(lambda: control.stopL(ARRIVED_M_S2))
        self._approaching, self._servoing = False, True
        taken = self._send(lambda: control.servoL(pose.tolist(), 0.0, 0.0, self.period_s, LOOKAHEAD_S, GAIN))
        control.waitPeriod(began)
        return taken

    def stop(self, deceleration_m_s2: float) -> None:
        control = self._control
        if control is None or not (self._approaching or self._servoing):
            return
        if self._servoing:
            self._send(lambda: control.servoStop(deceleration_m_s2))
        else:
            self._send(lambda: control.stopL(deceleration_m_s2))
        self._end_program()

    def close(self) -> None:
        """Let go of the three connections, and end the control program where no motion did."""
        self.stop_recording()
        self._end_program()
        for client in (self._control, self._receive, self._dashboard):
            if client is not None:
                client.disconnect()

    def _end_program(self) -> None:
        if self._control is None or self._ended:
            return
        self._ended = True
        self._send(self._control.stopScript)
        if self._lost is not None:
            end_program(self.host)

    def _armed(self) -> RTDEControlInterface:
        if self._control is None:
            raise RuntimeError("arm() comes first")
        return self._control

    def _send(self, command: Callable[[], object]) -> bool:
        """Send unless the connection is lost: ur_rtde would reconnect by itself and move on."""
        if self._lost is None:
            self._lost = self._silence()
        if self._lost is not None:
            return False
        try:
            return command() is not False
        except RuntimeError:
            self._lost = self._silence() or "the robot does not answer any more"
            return False


@contextmanager
def ur_robot(host: str) -> Iterator[UrRobot]:
    """Connect to the robot at `host`; nothing moves and nothing is uploaded before `arm`.

    Raises:
        MotionRefused: nobody answers there, or no Universal Robot.
    """
    for port, name in PORTS.items():
        _check_port(host, port, name)
    dashboard = DashboardClient(host)
    try:
        dashboard.connect()
        robot = UrRobot(host, dashboard)
    except (RuntimeError, ValueError) as error:
        mend = "check that a Universal Robots controller is switched on there"
        raise MotionRefused(f"the robot at {host} does not answer: {error}", mend=mend) from error
    try:
        yield robot
    finally:
        robot.close()


def _check_port(host: str, port: int, name: str) -> None:
    """ur_rtde's constructors wait long, and Ctrl-C does not reach them: ask first."""
    try:
        socket.create_connection((host, port), timeout=ANSWER_S).close()
    except (OSError, UnicodeError) as error:  # a name that no host can have is no OSError
        reason = getattr(error, "strerror", None) or error
        problem = f"no robot answers at {host} ({name}, port {port}): {reason}"
        raise MotionRefused(problem, mend="check address, cable and power") from error


def end_program(host: str) -> None:
    """Tell the controller's dashboard to stop its program; nothing is waited for but the connection."""
    with (
        suppress(OSError, UnicodeError),
        socket.create_connection((host, DASHBOARD_PORT), timeout=ANSWER_S) as line,
    ):
        line.sendall(b"stop\n")
        line.shutdown(socket.SHUT_WR)


UR = RobotKind(ur_robot, end_program)
