"""Series of measured files of one sample: regions, contrasts, and materials when hardly anything is known.

`settings` reads what files say of setpoint, amplitude and phase, `contrasts` finds the regions and how their phases
differ. `likelihood` tabulates what materials would show, and says how likely that makes the data; `sampling` draws
what is unknown. `series` is `phasemap.series`, and `report` is what it says.
"""
