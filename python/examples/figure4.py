"""Figure 4 of the paper: a line down that stops softly in the cycle after the contact."""

import rcc

arm = rcc.Arm("lwr")
down = arm.lin([0.538, 0.1, 0.234], velocity=0.1 * rcc.m / rcc.s, until=abs(arm.force.z) > 12 * rcc.N)
with rcc.connect() as cell:
    print(cell.run(down))
