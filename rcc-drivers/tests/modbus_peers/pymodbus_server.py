"""A Modbus TCP server made with pymodbus 3; argument: port. Units 1 and 2; unit 1's input registers hold each type in
each order, as pymodbus itself packs them: 24 registers an order, from 0, 24, 48, 72."""

import ctypes
import signal
import sys

from pymodbus.constants import Endian
from pymodbus.datastore import ModbusSequentialDataBlock, ModbusServerContext, ModbusSlaveContext
from pymodbus.payload import BinaryPayloadBuilder
from pymodbus.server import StartTcpServer

ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def registers(byte_order, word_order):
    builder = BinaryPayloadBuilder(byteorder=byte_order, wordorder=word_order)
    builder.add_16bit_uint(65535)
    builder.add_16bit_int(-2)
    builder.add_32bit_uint(4000000000)
    builder.add_32bit_int(-70000)
    builder.add_64bit_uint(2**53)
    builder.add_64bit_int(-5000000000)
    builder.add_32bit_float(-0.15625)
    builder.add_64bit_float(1.0e-9)
    words = builder.to_registers()
    return words + [0] * (24 - len(words))


def unit(inputs):
    return ModbusSlaveContext(
        di=ModbusSequentialDataBlock(0, [False, True] * 10),
        co=ModbusSequentialDataBlock(0, [False] * 20),
        hr=ModbusSequentialDataBlock(0, [0] * 20),
        ir=ModbusSequentialDataBlock(0, inputs),
        zero_mode=True,
    )


big, little = Endian.Big, Endian.Little
words = [word for order in [(big, big), (big, little), (little, little), (little, big)] for word in registers(*order)]
print("ready", flush=True)
StartTcpServer(
    context=ModbusServerContext(slaves={1: unit(words), 2: unit([2222] * 4)}, single=False),
    address=("127.0.0.1", int(sys.argv[1])),
    allow_reuse_address=True,
)
