"""Offline training of the three learned parts: film surrogate, fault classifier, clearance actor.

Nothing here runs on the device.  torch, onnx, scikit-learn and matplotlib are imported by the modules that
use them, so that ``import models`` stays cheap.
"""
