"""Names of types, which nothing asks for at run time."""

NDArray = ArrayLike = list
