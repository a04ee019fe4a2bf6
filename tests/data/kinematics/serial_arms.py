"""Forward kinematics of arms by their joints, computed by pinocchio 4.1.0: UR5e, UR10e and Franka Panda.

    pip install pin==4.1.0 numpy
    python3 serial_arms.py        # writes ur5e.csv, ur10e.csv and panda.csv beside it

The chains are built from Denavit-Hartenberg tables as published: Universal Robots, "DH parameters for calculations of
kinematics and dynamics" (standard convention), and Franka, "Robot and interface specifications" (convention of Craig,
flange included). The robot files of `configs/robots` give points and directions of axes instead, so both descriptions
have no number in common but the lengths.

A row: joints (rad), position of the flange (m), quaternion of the flange x y z w; all in the base frame.
"""

import math
import pathlib

import numpy
import pinocchio

HALF = math.pi / 2
# a (m), d (m), alpha (rad) of each joint: Rz(q) Tz(d) Tx(a) Rx(alpha).
STANDARD = {
    "ur5e": [
        (0, 0.1625, HALF), (-0.425, 0, 0), (-0.3922, 0, 0), (0, 0.1333, HALF), (0, 0.0997, -HALF), (0, 0.0996, 0),
    ],
    "ur10e": [
        (0, 0.1807, HALF), (-0.6127, 0, 0), (-0.57155, 0, 0), (0, 0.17415, HALF), (0, 0.11985, -HALF), (0, 0.11655, 0),
    ],
}
# a (m), d (m), alpha (rad) of each joint: Rx(alpha) Tx(a) Rz(q) Tz(d); the last row is the flange.
CRAIG = {
    "panda": [
        (0, 0.333, 0), (0, 0, -HALF), (0, 0.316, HALF), (0.0825, 0, HALF), (-0.0825, 0.384, -HALF), (0, 0, HALF),
        (0.088, 0, HALF), (0, 0.107, 0),
    ],
}
# Range of random positions, rad.
RANGES = {
    "ur5e": [(-2 * math.pi, 2 * math.pi)] * 6,
    "ur10e": [(-2 * math.pi, 2 * math.pi)] * 6,
    "panda": [
        (-2.8973, 2.8973), (-1.7628, 1.7628), (-2.8973, 2.8973), (-3.0718, -0.0698), (-2.8973, 2.8973),
        (-0.0175, 3.7525), (-2.8973, 2.8973),
    ],
}
POSITIONS = 1000


def turn_x(angle):
    return pinocchio.SE3(pinocchio.utils.rotate("x", angle), numpy.zeros(3))


def shift(x, z):
    return pinocchio.SE3(numpy.eye(3), numpy.array([x, 0.0, z]))


def model_of(before, after):
    """A model whose joint i turns about z, `before[i]` from the frame that joint i - 1 ends with, and its flange."""
    model = pinocchio.Model()
    parent, offset = 0, pinocchio.SE3.Identity()
    for number, (to, behind) in enumerate(zip(before, after)):
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), offset * to, f"j{number + 1}")
        offset = behind
    return model, parent, offset


def model_named(name):
    if name in STANDARD:
        rows = STANDARD[name]
        before = [pinocchio.SE3.Identity() for _ in rows]
        after = [shift(a, d) * turn_x(alpha) for a, d, alpha in rows]
        return model_of(before, after)
    *rows, (a, d, alpha) = CRAIG[name]
    before = [turn_x(alpha) * shift(a, 0) for a, _, alpha in rows]
    after = [shift(0, d) for _, d, _ in rows]
    model, last, offset = model_of(before, after)
    return model, last, offset * turn_x(alpha) * shift(a, d)


def main():
    random = numpy.random.default_rng(20_251)
    for name, ranges in RANGES.items():
        model, last, flange = model_named(name)
        data = model.createData()
        joints = [f"q{number + 1}" for number in range(len(ranges))]
        lines = [",".join([*joints, "x", "y", "z", "qx", "qy", "qz", "qw"])]
        for _ in range(POSITIONS):
            q = numpy.array([round(random.uniform(*limits), 6) for limits in ranges])
            pinocchio.forwardKinematics(model, data, q)
            pose = pinocchio.SE3ToXYZQUAT(data.oMi[last] * flange)
            lines.append(",".join([f"{x:.6f}" for x in q] + [f"{x:.15f}" for x in pose]))
        path = pathlib.Path(__file__).with_name(f"{name}.csv")
        path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
