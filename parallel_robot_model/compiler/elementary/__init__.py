"""Elementary functions of kernels: the same bits on every processor of one kind (x86-64).

Those of the C library choose their code by the processor, so that their last digits differ. These
are sums, products, quotients and square roots of floats, which IEEE 754 fixes; nothing is
contracted. The error of each is below 1 unit in the last place.
"""
