"""Where an arm and its model differ, which effect causes it, and how far the gap shrinks."""
