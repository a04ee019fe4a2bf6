"""Figure 3 of the paper: a straight line of the flange."""

import rcc

arm = rcc.Arm("lwr")
with rcc.connect() as cell:
    print(cell.run(arm.lin([0.538, 0.15, 0.384], velocity=0.15 * rcc.m / rcc.s)))
