"""Images of surfaces in Dask arrays, of any size.

`parts` cuts an image into parts that do not know each other, `image` makes one Dask array of them. Nothing is
computed before somebody asks for it.
"""
