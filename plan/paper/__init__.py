"""The paper's methods and its peers, to compare with: no plan needs them."""
