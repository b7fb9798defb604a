"""Shapes, distances, and the proof of clearance between samples."""
