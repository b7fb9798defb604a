"""Where the gap between an arm and its model lies, which effect causes it, and how far it shrinks."""
