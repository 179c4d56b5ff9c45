"""Names for the integer and float widths that our messages have on the wire and in the log.

A field's annotation is the one place that says how wide it is: the log derives its ROS 2 message
definitions from it (logs_tools/hippomat_logs/schema.py). The values themselves are plain Python and NumPy.
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

U8 = Annotated[int, "uint8"]
U16 = Annotated[int, "uint16"]
U32 = Annotated[int, "uint32"]
U64 = Annotated[int, "uint64"]
I8 = Annotated[int, "int8"]
I16 = Annotated[int, "int16"]
I32 = Annotated[int, "int32"]
I64 = Annotated[int, "int64"]
F64 = Annotated[float, "float64"]

U8Array = Annotated[NDArray[np.uint8], "uint8[]"]
U16Array = Annotated[NDArray[np.uint16], "uint16[]"]
U32Array = Annotated[NDArray[np.uint32], "uint32[]"]
I8Array = Annotated[NDArray[np.int8], "int8[]"]
I16Array = Annotated[NDArray[np.int16], "int16[]"]
I32Array = Annotated[NDArray[np.int32], "int32[]"]
F32Array = Annotated[NDArray[np.float32], "float32[]"]
F64Array = Annotated[NDArray[np.float64], "float64[]"]
