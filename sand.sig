a(position: int)
b(position: int)
c(position: int)
