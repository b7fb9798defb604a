"""Identification of robot arms and diagnosis of the gap between an arm and its model."""
