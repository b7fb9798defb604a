"""From a URDF and an arm to a model whose gap is noise: diagnose, patch, excite, record,
and again.
"""
