# SPDX-License-Identifier: BSD-3-Clause
"""A drive to simulate features along where no recorded trajectory is at hand: round a block of
houses, slower in corners, with a wait at every second one."""
import math
import random

RATE = 10.0  # Hz
CRUISE, CORNER, ACCELERATION = 9.0, 4.0, 1.5  # m/s, m/s, m/s^2
WAIT = 4.0  # s


def circuit(width, depth, radius):
    """Length (m) of a round trip, and a function from the way (m) to x, z (m), heading (rad) and
    whether it is in a corner. Straight on is z, right is x; every corner is to the right."""
    sides = [depth - 2 * radius, width - 2 * radius] * 2
    arc = radius * math.pi / 2
    parts, x, z, heading = [], 0.0, 0.0, 0.0
    for side in sides:
        parts.append((side, x, z, heading, False))
        x, z = x + side * math.sin(heading), z + side * math.cos(heading)
        parts.append((arc, x, z, heading, True))
        right = (math.cos(heading), -math.sin(heading))  # x, z
        ahead = (math.sin(heading), math.cos(heading))
        x, z = x + radius * (right[0] + ahead[0]), z + radius * (right[1] + ahead[1])
        heading += math.pi / 2
    length = sum(p[0] for p in parts)

    def at(way):
        way %= length
        for size, x0, z0, h, corner in parts:
            if way < size:
                break
            way -= size
        if not corner:
            return x0 + way * math.sin(h), z0 + way * math.cos(h), h, False
        turn = way / radius
        forward, aside = radius * math.sin(turn), radius * (1 - math.cos(turn))
        return (x0 + forward * math.sin(h) + aside * math.cos(h),
                z0 + forward * math.cos(h) - aside * math.sin(h), h + turn, True)

    return length, at


def drive(frames, seed):
    """Poses of the camera, rows of 12 numbers (KITTI)."""
    dice = random.Random(seed)
    _, at = circuit(dice.uniform(80, 120), dice.uniform(60, 100), dice.uniform(8, 12))
    way, speed, waiting, corners, inside, rows = 0.0, 0.0, 0.0, 0, False, []
    for _ in range(frames):
        x, z, heading, corner = at(way)
        c, s = math.cos(heading), math.sin(heading)
        rows.append((c, 0, s, x, 0, 1, 0, 0, -s, 0, c, z))
        if inside and not corner:
            corners += 1
            waiting = WAIT if corners % 2 == 0 else 0.0
        inside = corner
        # The corner ahead, as far as it takes to slow down.
        braking = (CRUISE**2 - CORNER**2) / (2 * ACCELERATION)
        slow = corner or at(way + braking)[3]
        if waiting > 0:
            waiting -= 1 / RATE
            wanted = 0.0
        else:
            wanted = CORNER if slow else CRUISE
        change = max(-3 * ACCELERATION, min(ACCELERATION, (wanted - speed) * RATE)) / RATE
        speed = max(0.0, speed + change)
        way += speed / RATE
    return rows


def write_drive(file, frames, seed):
    with open(file, "w", encoding="utf-8") as stream:
        for row in drive(frames, seed):
            stream.write(" ".join(f"{v:.9e}" for v in row) + "\n")
