"""Materials of an image: which there are, and which of them are the same.

`survey` goes once over the surface and says how large and how varied it is; `distinct` gives every different
material one row, so that each is solved once.
"""
