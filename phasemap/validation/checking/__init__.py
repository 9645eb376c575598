"""Whether what an image says of itself holds: `check` looks at every pixel, and solves it again.

`claims` reads what the file says it is; `invariants` has what must hold in every pixel; `again` solves all pixels as
they were made, and those that `sample` draws by another solver; `repeat` and `compare` judge what the two find, within
`tolerance`; `lines` goes along whole lines again where pixels have a history.
"""
