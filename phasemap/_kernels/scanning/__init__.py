"""A tip that moves on: the state of the oscillation goes from pixel to pixel.

`quasi_static` walks along a line at rest and keeps its branch; `feedback_loop` is lock-in, controller and scanner, and
moves the tip while it oscillates. Between two samples of the loop the motion is a `slow_flow` of the averaged lever,
with what `higher_harmonics` add, or is marched through every contact (`periods`). `line` goes through the pixels.
"""
