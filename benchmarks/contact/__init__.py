"""Many random contacts, judged by laws and closed forms that the program does not use."""
