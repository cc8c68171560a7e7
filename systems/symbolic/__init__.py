"""Maps and flows from SymPy expressions: derivatives by SymPy, machine code by LLVM or heyoka."""
