def make(_):
    pass
