"""All work by MPI: prints the bits; run by ``mpiexec -n 3 python -m mpi4py.futures``."""

import json
import sys

from tests.scaling.cases import ALL, bits

if __name__ == "__main__":
    from mpi4py.futures import MPIPoolExecutor

    with MPIPoolExecutor() as executor:
        sys.stdout.write(json.dumps({name: bits(work(executor)) for name, work in ALL.items()}))
