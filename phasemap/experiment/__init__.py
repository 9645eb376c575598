"""What a user describes: a sample, a microscope, and how it is operated.

A sample is a `surface` of `material`, measured or made by `generate` and seen by a tip of finite size
(`dilation`); a `microscope` is a lever, a tip, a drive and the forces of `interaction`. How it scans is in
`control`, how exact the answer has to be in `accuracy`, and what a real instrument adds in `realism`.
"""
