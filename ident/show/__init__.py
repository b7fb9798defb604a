"""All that a person sees: terminal, HTML report, Rerun timeline."""
