"""Maps and flows from symbols: derivatives by SymPy, machine code by LLVM or heyoka."""
