"""The public board: sessions without their answers, sealed truths, and scores of whoever answers."""
