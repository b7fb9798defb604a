"""The simulated arm: hardware's stand-in, built of other laws than the catalogue of effects."""
