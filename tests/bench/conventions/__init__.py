"""Random conventions of logs and URDFs: logs of many arms, what is changed in them, and an oracle that knows it."""
