# Written by tools/write_stubs.py from the interface files.
from collections.abc import Sequence
import numpy
from numpy.typing import NDArray

class UUID:
    @property
    def uuid(self) -> NDArray[numpy.uint8]: ...
    @uuid.setter
    def uuid(self, value: Sequence[int] | NDArray[numpy.uint8]) -> None: ...
    def __init__(
        self,
        *,
        uuid: Sequence[int] | NDArray[numpy.uint8] = ...,
    ) -> None: ...
