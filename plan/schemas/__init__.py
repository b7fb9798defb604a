"""What the result files of `plan` hold, published as JSON Schema."""
