"""The fault classifier: recordings, ladder, calibration, novelty, judge; measured recordings of any
rig."""
