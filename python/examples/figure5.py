"""Figure 5 of the paper: a torch that burns on a part of the path only; CANCEL (Ctrl-C) stops both."""

import rcc

arm = rcc.Arm("lwr")
weld = arm.lin([0.538, -0.15, 0.384], velocity=0.1 * rcc.m / rcc.s)
weld = weld.switch(arm.output("torch"), on=50 * rcc.mm, off=100 * rcc.mm)
with rcc.connect() as cell:
    print(cell.run(weld))
