"""The public board: sessions without answers, sealed truths, and scores of whoever answers."""
