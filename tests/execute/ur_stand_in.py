"""A process that speaks a UR controller's protocols on a loopback address: RTDE version 2, dashboard, script.

It is no model of an arm: its joints are its tool pose, `movel` goes straight at the asked speed, `servoj`
follows with a short delay. What it does take seriously is the protocol that ur_rtde's clients speak: the
messages V, v, I, O, S, U and P, the types of the variables, the uploaded control script's main loop with its
handshake in output_int_register_0 (1 ready, 2 done, cleared by command 0), the program's state and the
safety bits. Faults happen after a given number of servo commands. Every motion command goes to a journal.

    python ur_stand_in.py 127.0.0.2 --journal FILE [--protect-after N | --die-after N | --freeze-after N] ...
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import signal
import struct
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

TICK_S = 0.002
STOPPED, PLAYING = 1, 2
NORMAL, PROTECTIVE = 1, 3
RUNNING = 7
SERVO_DELAY_S = 0.02
READY, DONE = 1, 2
MOVEL, SERVO_STOP, SERVOL, INVERSE_ARGS, STOPL, WATCHDOG, SAFE_POSE, INVERSE, STOP_SCRIPT = (
    3, 16, 24, 30, 33, 35, 36, 46, 255
)  # fmt: skip
REALTIME = {24, 11, 9, 10, 6, 25, 26, 27, 38, 58}
"""Commands that the script's main loop answers with "ready" at once (rtde_control.script)."""

VECTORS = {"actual_tool_accelerometer": "VECTOR3D", "payload_cog": "VECTOR3D", "joint_mode": "VECTOR6INT32"}
INTEGERS = {"robot_mode": "INT32", "safety_mode": "INT32", "runtime_state": "UINT32"}
BITS = {"robot_status_bits": "UINT32", "safety_status_bits": "UINT32", "speed_slider_mask": "UINT32"}
WIDE = {"actual_digital_input_bits": "UINT64", "actual_digital_output_bits": "UINT64"}
SIXES = ("_q", "_qd", "_qdd", "_current", "_moment", "_pose", "_speed", "_force", "_output", "_temperatures",
         "_wrench", "_inertia", "_torque", "joint_voltage")  # fmt: skip
FORMATS = {"INT32": "i", "UINT32": "I", "UINT64": "Q", "UINT8": "B", "DOUBLE": "d", "VECTOR3D": "3d",
           "VECTOR6D": "6d", "VECTOR6INT32": "6i"}  # fmt: skip


def rtde_type(name: str) -> str:
    """The type that RTDE's guide gives the variable `name`."""
    for known in (VECTORS, INTEGERS, BITS, WIDE):
        if name in known:
            return known[name]
    if "int_register" in name:
        return "INT32"
    if "bit_registers" in name:
        return "UINT32"
    if "digital_output" in name or name.endswith("_mask") or name.endswith("_type"):
        return "UINT8"
    if name == "actual_robot_current":
        return "DOUBLE"
    return "VECTOR6D" if name.endswith(SIXES) else "DOUBLE"


class Arm:
    """Pose, program and registers; `tick` is one period of the controller."""

    def __init__(self, options: argparse.Namespace, journal: TextIO) -> None:
        self.options, self.journal = options, journal
        self.time_s = 100.0
        self.pose: list[float] = list(options.pose)
        self.demanded = list(self.pose)
        self.speed = [0.0] * 6
        self.move: tuple[list[float], float] | None = None
        self.servoing = self.busy = self.protective = self.dropped = False
        self.program = STOPPED
        self.servos = 0
        self.watchdog_s: float | None = None
        self.heard_s = self.time_s
        self.inputs: dict[str, Any] = {}
        self.outputs: dict[str, Any] = {}

    def note(self, command: str, **values: Any) -> None:
        """One line of the journal."""
        self.journal.write(json.dumps({"command": command, **values}) + "\n")
        self.journal.flush()

    def receive(self, values: dict[str, Any]) -> None:
        """Input registers from a client; a new servo command counts here, where none is lost."""
        self.inputs.update(values)
        self.heard_s = self.time_s
        if self.program == PLAYING and self.inputs.get("input_int_register_0") == SERVOL:
            self.servos += 1
            self.note("servoL", pose=self.doubles(0, 6))
            self.fault()

    def fault(self) -> None:
        """The fault that the options ask for after this many servo commands."""
        if self.servos == self.options.protect_after:
            self.protective, self.program, self.servoing = True, STOPPED, False
        if self.servos == self.options.die_after:
            os._exit(1)
        if self.servos == self.options.drop_after:
            self.dropped = True
        if self.servos == self.options.freeze_after:
            os.kill(os.getpid(), signal.SIGSTOP)

    def tick(self) -> None:
        self.time_s += TICK_S
        before = list(self.pose)
        if self.program == PLAYING:
            self.check_watchdog()
        if self.program == PLAYING:
            self.script()
            self.advance()
        self.speed = [(now - then) / TICK_S for now, then in zip(self.pose, before, strict=True)]

    def check_watchdog(self) -> None:
        if self.watchdog_s is not None and self.time_s - self.heard_s > self.watchdog_s:
            self.note("watchdog stopped the program")
            self.halt()
            self.program = STOPPED

    def script(self) -> None:
        """One turn of the uploaded control script's main loop."""
        command = self.inputs.get("input_int_register_0", 0)
        if command in REALTIME:
            self.process(command)
            self.outputs["output_int_register_0"] = READY
        elif command == 0:
            self.busy = False
            self.outputs["output_int_register_0"] = READY
        elif not self.busy:
            self.busy = True
            self.process(command)
        elif self.move is None and self.program == PLAYING:
            self.outputs["output_int_register_0"] = DONE

    def process(self, command: int) -> None:
        if command == SERVOL:
            self.demanded, self.servoing, self.move = self.doubles(0, 6), True, None
        elif command == MOVEL:
            speed, background = self.doubles(6, 1)[0], bool(self.inputs.get("input_int_register_1"))
            self.note("moveL", pose=self.doubles(0, 6), speed=speed, background=background)
            self.move, self.servoing = (self.doubles(0, 6), speed), False
            if background:
                self.outputs["output_int_register_0"] = DONE
        elif command in (SERVO_STOP, STOPL):
            self.note("servoStop" if command == SERVO_STOP else "stopL")
            self.halt()
        elif command == WATCHDOG:
            self.watchdog_s = 1 / self.doubles(0, 1)[0]
        elif command == SAFE_POSE:
            self.outputs["output_int_register_1"] = int(self.doubles(2, 1)[0] >= self.options.floor)
        elif command in (INVERSE, INVERSE_ARGS):
            for index, value in enumerate(self.doubles(0, 6)):
                self.outputs[f"output_double_register_{index}"] = value
        elif command == STOP_SCRIPT:
            self.note("stopScript")
            self.halt()
            self.program, self.watchdog_s = STOPPED, None

    def doubles(self, first: int, count: int) -> list[float]:
        return [self.inputs.get(f"input_double_register_{first + index}", 0.0) for index in range(count)]

    def halt(self) -> None:
        self.move, self.servoing, self.demanded = None, False, list(self.pose)

    def advance(self) -> None:
        if self.move is not None:
            goal, speed = self.move
            away = [to - at for to, at in zip(goal, self.pose, strict=True)]
            longest = max(
                math.dist(goal[:3], self.pose[:3]) / speed, math.dist(goal[3:], self.pose[3:]) / 1.0
            )
            share = 1.0 if longest <= TICK_S else TICK_S / longest
            self.pose = [at + share * step for at, step in zip(self.pose, away, strict=True)]
            self.demanded = list(self.pose)
            if share == 1.0:
                self.move = None
        elif self.servoing:
            share = TICK_S / SERVO_DELAY_S
            self.pose = [at + share * (to - at) for at, to in zip(self.pose, self.demanded, strict=True)]

    def value(self, name: str) -> Any:
        """The present value of an output variable."""
        state = {
            "timestamp": self.time_s,
            "actual_TCP_pose": self.pose,
            "actual_q": self.pose,
            "target_q": self.demanded,
            "target_TCP_pose": self.demanded,
            "actual_TCP_speed": self.speed,
            "target_TCP_speed": self.speed,
            "speed_scaling": 1.0,
            "robot_mode": RUNNING if not self.options.off else 3,
            "safety_mode": PROTECTIVE if self.protective else NORMAL,
            "runtime_state": self.program,
            "robot_status_bits": 0b1 | (0b10 if self.program == PLAYING else 0),
            "safety_status_bits": 0b100 if self.protective else 0b1,
        }
        if name in state:
            return state[name]
        kind = rtde_type(name)
        return self.outputs.get(name, [0] * int(FORMATS[kind][0]) if kind.startswith("VECTOR") else 0)


class RtdeClient:
    """One connection to port 30004."""

    def __init__(self, arm: Arm, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.arm, self.reader, self.writer = arm, reader, writer
        self.outputs: list[str] = []
        self.inputs: list[list[str]] = []
        self.every, self.started = 1, False

    async def serve(self) -> None:
        try:
            while True:
                size, kind = struct.unpack(">HB", await self.reader.readexactly(3))
                self.answer(chr(kind), await self.reader.readexactly(size - 3))
        except (asyncio.IncompleteReadError, ConnectionError):
            self.started = False

    def answer(self, kind: str, payload: bytes) -> None:
        if kind == "V":
            self.send(kind, struct.pack(">?", payload == b"\x00\x02"))
        elif kind == "v":
            self.send(kind, struct.pack(">4I", 5, 12, 0, 1101319))
        elif kind == "O":
            rate_hz = struct.unpack(">d", payload[:8])[0]
            self.every = max(1, round(1 / rate_hz / TICK_S))
            self.outputs = [name for name in payload[8:].decode().split(",") if name]
            self.send(kind, b"\x01" + ",".join(map(rtde_type, self.outputs)).encode())
        elif kind == "I":
            self.inputs.append([name for name in payload.decode().split(",") if name])
            self.send(kind, bytes([len(self.inputs)]) + ",".join(map(rtde_type, self.inputs[-1])).encode())
        elif kind in "SP":
            self.started = kind == "S"
            self.send(kind, b"\x01")
        elif kind == "U":
            names = self.inputs[payload[0] - 1]
            layout = ">" + "".join(FORMATS[rtde_type(name)] for name in names)
            if all(not rtde_type(name).startswith("VECTOR") for name in names):
                self.arm.receive(dict(zip(names, struct.unpack(layout, payload[1:]), strict=True)))

    def send(self, kind: str, payload: bytes) -> None:
        self.writer.write(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def publish(self, count: int) -> None:
        """One data package of the asked variables."""
        if not self.started or self.writer.is_closing() or count % self.every:
            return
        packed = b"\x01"
        for name in self.outputs:
            layout, value = FORMATS[rtde_type(name)], self.arm.value(name)
            packed += struct.pack(">" + layout, *(value if isinstance(value, list) else [value]))
        self.send("U", packed)


async def serve_dashboard(arm: Arm, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Port 29999: a banner, then one line for a line."""
    writer.write(b"Connected: Universal Robots Dashboard Server\n")
    answers = {
        "polyscopeversion": "URSoftware 5.12.0.1101319 (Nov 22 2021)",
        "get serial number": "20210000001",
        "get robot model": "UR5",
        "is in remote control": "false" if arm.options.local else "true",
        "robotmode": "Robotmode: RUNNING",
        "stop": "Stopped",
    }
    while line := await reader.readline():
        request = line.decode().strip().lower()
        if request == "stop":
            arm.note("dashboard stop")
            arm.halt()
            arm.program = STOPPED
        writer.write((answers.get(request, f"could not understand: '{request}'") + "\n").encode())


async def serve_script(arm: Arm, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Port 30003: a program `def rtde_control(): ... end` is taken, and runs from then on."""
    text = ""
    while data := await reader.read(65536):
        text += data.decode()
        if text.startswith("def rtde_control") and text.rstrip().endswith("\nend"):
            arm.note("script", lines=text.count("\n"))
            arm.program, text = PLAYING, ""


def end_with_parent() -> None:
    """Standard input closes when the test is gone."""
    sys.stdin.read()
    os._exit(0)


async def main(options: argparse.Namespace) -> None:
    with Path(options.journal).open("w", encoding="utf-8") as journal:
        arm, clients = Arm(options, journal), list[RtdeClient]()

        async def rtde(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            clients.append(RtdeClient(arm, reader, writer))
            await clients[-1].serve()
            writer.close()

        async def lines(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            serve = serve_dashboard if writer.get_extra_info("sockname")[1] == 29999 else serve_script
            with suppress(ConnectionError):
                await serve(arm, reader, writer)
            writer.close()

        await asyncio.start_server(rtde, options.host, 30004)
        for port in (29999, 30003):
            await asyncio.start_server(lines, options.host, port)
        threading.Thread(target=end_with_parent, daemon=True).start()
        print("ready", flush=True)
        began, count = time.monotonic(), 0
        while True:
            count += 1
            arm.tick()
            for client in clients:
                if arm.dropped:
                    client.writer.close()
                client.publish(count)
            arm.dropped = False
            await asyncio.sleep(max(0.0, began + count * TICK_S - time.monotonic()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("host")
    parser.add_argument("--journal", required=True)
    parser.add_argument("--pose", type=float, nargs=6, default=[0.40, 0.0, 0.30, 1.2, 1.2, 1.2])
    parser.add_argument("--floor", type=float, default=-1.0, help="lowest z [m] that it calls safe")
    parser.add_argument("--protect-after", type=int, default=-1)
    parser.add_argument("--die-after", type=int, default=-1)
    parser.add_argument("--freeze-after", type=int, default=-1)
    parser.add_argument("--drop-after", type=int, default=-1, help="closes RTDE connections, takes new ones")
    parser.add_argument("--local", action="store_true", help="not in remote control")
    parser.add_argument("--off", action="store_true", help="powered off")
    asyncio.run(main(parser.parse_args()))
