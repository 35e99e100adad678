"""How do child processes start, and when does Ctrl-C take effect?"""
