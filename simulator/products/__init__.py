"""Level-0 products: files, truth and parameters of a sequence, and their check."""

from simulator.products.check import check_level0
from simulator.products.findings import Finding
from simulator.products.sequence import FrameSequence
from simulator.products.write import write_level0

__all__ = ["Finding", "FrameSequence", "check_level0", "write_level0"]
