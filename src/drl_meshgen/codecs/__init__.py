"""Results of the stages as files that a person can open: VTU for meshes, Parquet for tables; one module per stage."""

from drl_meshgen.codecs.assembly import ASSEMBLY
from drl_meshgen.codecs.cleanup import CLEANUP
from drl_meshgen.codecs.comparison import COMPARISON
from drl_meshgen.codecs.files import Codec
from drl_meshgen.codecs.final import FINAL
from drl_meshgen.codecs.layout import LAYOUT
from drl_meshgen.codecs.lifted import LIFTED
from drl_meshgen.codecs.model import MODEL
from drl_meshgen.codecs.partition import PARTITION
from drl_meshgen.codecs.quality import QUALITY
from drl_meshgen.codecs.ricci import RICCI
from drl_meshgen.codecs.seams import SEAMS
from drl_meshgen.codecs.sizing import SIZING
from drl_meshgen.codecs.subdomains import SUBDOMAINS

__all__ = [
    "ASSEMBLY",
    "CLEANUP",
    "COMPARISON",
    "FINAL",
    "LAYOUT",
    "LIFTED",
    "MODEL",
    "PARTITION",
    "QUALITY",
    "RICCI",
    "SEAMS",
    "SIZING",
    "SUBDOMAINS",
    "Codec",
]
