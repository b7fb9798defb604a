"""What the result files hold: one typed record a kind of file, published as JSON Schema."""
