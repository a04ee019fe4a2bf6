"""RCC, the Robot Control Core, from Python: build nets, run them, watch them.

Nets run in the cell, in hard real time; this program may be slow, or die.
"""

from . import _io
from .actions import Action, parallel
from .blocking import Cell, Command
from .blocks import UNSET, Block, Port
from .commands import LOST_AFTER_S, AsyncCell, AsyncCommand, Outcome
from .errors import ActionFailed, Busy, CellNotFound, NetCanceled, NetFault, NetRejected, RccError
from .expressions import Expr, analog_input, digital_input
from .motions import Arm, Motion, sequence
from .outputs import Device, Gripper, Output
from .set_points import Channel
from .streams import Batch, Recording, Sample
from .tools import Net, Simulation
from .units import Hz, K, N, Quantity, deg, kg, m, mm, ms, rad, s

__all__ = [
    "Action", "ActionFailed", "Arm", "AsyncCell", "AsyncCommand", "Batch", "Block", "Busy", "Cell", "CellNotFound",
    "Channel", "Command", "Device", "Expr", "Gripper", "Hz", "K", "Motion", "N", "Net", "NetCanceled", "NetFault",
    "NetRejected", "Outcome", "Output", "Port", "Quantity", "RccError", "Recording", "Sample", "Simulation",
    "UNSET", "aconnect", "analog_input", "connect", "deg", "digital_input", "kg", "m", "mm", "ms", "parallel",
    "rad", "s", "sequence",
]  # fmt: skip


def connect(
    cell: str | None = None, *, url: str | None = None, token: str | None = None, lost_after: float = LOST_AFTER_S
) -> Cell:
    """Connects to a cell: `with rcc.connect() as cell:`.

    `cell` is the name of a cell of this machine (default: RCC_CELL, or `demo`); `url` and `token` (default: RCC_URL and
    RCC_TOKEN) reach another machine's loader. A program that gives no sign of life for `lost_after` s counts as lost.
    """
    address = _io.Address(cell, url, token)
    return Cell(AsyncCell(address, _io.BlockingIo(address), lost_after))


def aconnect(
    cell: str | None = None, *, url: str | None = None, token: str | None = None, lost_after: float = LOST_AFTER_S
) -> AsyncCell:
    """Connects to a cell from an asynchronous program: `async with rcc.aconnect() as cell:`."""
    address = _io.Address(cell, url, token)
    return AsyncCell(address, _io.AsyncIo(address), lost_after)
