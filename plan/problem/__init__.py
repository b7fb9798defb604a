"""What is asked: the task, its file, and the result that certifies itself."""
