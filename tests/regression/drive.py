# SPDX-License-Identifier: BSD-3-Clause
"""A drive of our own for the simulation of features: around a block, and some of the way again."""
import math

LENGTH, WIDTH, RADIUS = 110.0, 70.0, 9.0  # m: sides of the block, radius of its corners
SPEED, RATE = 8.0, 10.0  # m/s, Hz


def _on_lap(s):
    """Position (x right, z ahead) and heading (rad, to the right) at a distance along the lap."""
    x = z = heading = 0.0
    for side in (LENGTH, WIDTH, LENGTH, WIDTH):
        straight = side - 2 * RADIUS
        if s <= straight:
            return x + s * math.sin(heading), z + s * math.cos(heading), heading
        x, z = x + straight * math.sin(heading), z + straight * math.cos(heading)
        s -= straight
        arc = RADIUS * math.pi / 2
        turn = min(s, arc) / RADIUS
        forward, aside = RADIUS * math.sin(turn), RADIUS * (1 - math.cos(turn))
        x += forward * math.sin(heading) + aside * math.cos(heading)
        z += forward * math.cos(heading) - aside * math.sin(heading)
        heading += turn
        if s <= arc:
            return x, z, heading
        s -= arc
    return x, z, heading


def drive_text(laps=1.25):
    """KITTI's format: a row of T_w_c (camera: x right, y down, z ahead) per frame."""
    lap = 2 * (LENGTH + WIDTH) - 8 * RADIUS + 2 * math.pi * RADIUS
    text = ""
    for i in range(int(laps * lap / SPEED * RATE)):
        s = i * SPEED / RATE
        x, z, heading = _on_lap(s % lap)
        # Nobody keeps to the middle of the lane, and roads are not flat.
        aside = 0.3 * math.sin(s / 17.0)
        heading += 0.3 / 17.0 * math.cos(s / 17.0)
        pitch = 0.006 * math.sin(s / 9.0)
        x, z = x + aside * math.cos(heading), z - aside * math.sin(heading)
        c, n, cp, sp = math.cos(heading), math.sin(heading), math.cos(pitch), math.sin(pitch)
        row = [c, n * sp, n * cp, x, 0.0, cp, -sp, 0.04 * math.sin(s / 9.0), -n, c * sp, c * cp, z]
        text += " ".join(f"{v:.9f}" for v in row) + "\n"
    return text
