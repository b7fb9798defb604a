"""The arm: from its URDF to inverse dynamics, regressors and the lumped three-joint model."""
