"""The report: one self-contained page, the verdict first."""
