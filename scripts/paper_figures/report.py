def write_page(n):
    pass
