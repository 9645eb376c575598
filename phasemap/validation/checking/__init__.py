"""Whether what an image says of itself holds: `check` looks at every pixel, and solves some of them again.

`claims` reads what the file says it is; `invariants` has what must hold in every pixel; `sample` draws pixels; `again`
solves them, `compare` and `repeat` judge what another solver and the same one find, within `tolerance`; `lines` goes
along whole lines again where pixels have a history.
"""
