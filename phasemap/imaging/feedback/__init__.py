"""Scans in time: `simulator` fills an image line by line.

`lines` turns a control into numbers of the feedback loop, cuts a line of the surface into segments and moves the tip
along them; `tuning` finds the loop's gains, says how far they are from ringing, and tries them.
"""
