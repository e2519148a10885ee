"""Commands of Code_Aster that its decks use, and a check of a command file without the program.

The table holds what 15, 16 and 17 accept alike. Names, words and bounds are read off the public
command catalogues of 15.2 (November 2020), 16 (most of 2022, STAT_NON_LINE of 2023) and 17 (October
2025). Of 16, AFFE_MODELE, DEFI_COMPOR, DEFI_LIST_REEL and POST_RELEVE_T were not at hand: 15.2 and
17 agree on them.

- A keyword that one of the three lacks is left out, as MAILLE and RESI_INTE are.
- A keyword is needed where it is mandatory, or the last one left of several, or named by others.
- A word that wants keywords of its own, as RELATION='MFRONT', is left out.
- DEFORMATION and ALGO_INTE have the words of the law MONOCRISTAL.
- RESI_INTE_RELA stands although 17 names it RESI_INTE: it takes the old name with a warning.
"""

from __future__ import annotations

import ast
import builtins
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

MANY = 10**9
"""Values or occurrences of a keyword without a limit."""


@dataclass(frozen=True)
class Text:
    """A keyword of words, any word where `words` is empty."""

    words: tuple[str, ...] = ()
    needed: bool = False
    most: int = 1


@dataclass(frozen=True)
class Number:
    """A keyword of real or whole numbers, from `least` on."""

    whole: bool = False
    least: float = -math.inf
    needed: bool = False
    most: int = 1


@dataclass(frozen=True)
class Concept:
    """A keyword of what one of the commands `makers` returns."""

    makers: tuple[str, ...]
    needed: bool = False
    most: int = 1


@dataclass(frozen=True)
class Count:
    """How many of some keywords stand together, from `least` to `most`."""

    names: tuple[str, ...]
    least: int
    most: int

    def fault(self, present: Mapping[str, object]) -> str | None:
        """What is wrong with the keywords that are present, if anything."""
        found = [name for name in self.names if name in present]
        if len(found) < self.least:
            return f"has none of {', '.join(self.names)}"
        if len(found) > self.most:
            return f"has {' and '.join(found)}, which exclude each other"
        return None


@dataclass(frozen=True)
class Needs:
    """Keywords that the keyword `first` asks for."""

    first: str
    others: tuple[str, ...]

    def fault(self, present: Mapping[str, object]) -> str | None:
        """What is wrong with the keywords that are present, if anything."""
        lacking = [name for name in self.others if name not in present]
        if self.first in present and lacking:
            return f"has {self.first} without {', '.join(lacking)}"
        return None


@dataclass(frozen=True)
class Factor:
    """A keyword of keywords, each occurrence of it an `_F(...)`."""

    keywords: Mapping[str, Keyword]
    rules: tuple[Count | Needs, ...] = ()
    needed: bool = False
    most: int = MANY


@dataclass(frozen=True)
class Command:
    """A command; `constants` tells whether it takes keywords of any name beside its own."""

    keywords: Mapping[str, Keyword]
    rules: tuple[Count | Needs, ...] = ()
    constants: bool = False


Keyword = Text | Number | Concept | Factor


def one_of(*names: str) -> Count:
    """Exactly one of the keywords."""
    return Count(names, 1, 1)


def some_of(*names: str) -> Count:
    """One of the keywords or more."""
    return Count(names, 1, MANY)


def at_most_one_of(*names: str) -> Count:
    """None or one of the keywords."""
    return Count(names, 0, 1)


ANY = Text()
NEEDED = Text(needed=True)
NAMES = Text(most=MANY)
NEEDED_NAMES = Text(needed=True, most=MANY)
YES = Text(("OUI",))
REAL = Number()
NEEDED_REAL = Number(needed=True)
REALS = Number(most=MANY)
UNIT = Number(whole=True, least=2)

MESH = Concept(("LIRE_MAILLAGE",))
MODEL = Concept(("AFFE_MODELE",), needed=True)
MATERIAL = ("DEFI_MATERIAU",)
FUNCTION = Concept(("FORMULE",))
TIMES = Concept(("DEFI_LIST_REEL",))
RESULT = Concept(("STAT_NON_LINE", "CALC_CHAMP"))
NEEDED_RESULT = Concept(RESULT.makers, needed=True)

FIELDS = ("DEPL", "FORC_NODA", "REAC_NODA", "SIEF_ELGA", "VARI_ELGA")
DIRECTIONS = ("DX", "DY", "DZ")

COMMANDS: Mapping[str, Command] = {
    "DEBUT": Command({"LANG": ANY}),
    "LIRE_MAILLAGE": Command(
        {"FORMAT": Text(("ASTER", "GIBI", "GMSH", "IDEAS", "MED")), "UNITE": UNIT}
    ),
    "AFFE_MODELE": Command(
        {
            "MAILLAGE": Concept(MESH.makers, needed=True),
            "AFFE": Factor(
                {
                    "TOUT": YES,
                    "GROUP_MA": NAMES,
                    "PHENOMENE": Text(("MECANIQUE",), needed=True),
                    "MODELISATION": Text(("3D",), needed=True),
                },
                rules=(one_of("TOUT", "GROUP_MA"),),
                needed=True,
            ),
        }
    ),
    "DEFI_MATERIAU": Command(
        {
            "ELAS_ORTH": Factor(
                dict.fromkeys(("E_L", "E_T", "NU_LT", "G_LT"), NEEDED_REAL)
                | dict.fromkeys(("E_N", "NU_LN", "NU_TN", "G_LN", "G_TN"), REAL),
                most=1,
            ),
            "MONO_VISC1": Factor(dict.fromkeys("NKC", NEEDED_REAL), most=1),
            "MONO_ISOT1": Factor(
                dict.fromkeys(("R_0", "Q", "B"), NEEDED_REAL)
                | dict.fromkeys(("H", "H1", "H2", "H3", "H4"), REAL),
                rules=(
                    one_of("H", "H1"),
                    Needs("H1", ("H2", "H3", "H4")),
                    *(at_most_one_of("H", name) for name in ("H2", "H3", "H4")),
                ),
                most=1,
            ),
            "MONO_CINE1": Factor({"D": NEEDED_REAL}, most=1),
        },
        rules=(some_of("ELAS_ORTH", "MONO_VISC1", "MONO_ISOT1", "MONO_CINE1"),),
    ),
    "CREA_TABLE": Command(
        {
            "LISTE": Factor(
                {
                    "PARA": NEEDED,
                    "LISTE_R": REALS,
                    "LISTE_I": Number(whole=True, most=MANY),
                    "LISTE_K": NAMES,
                },
                rules=(one_of("LISTE_R", "LISTE_I", "LISTE_K"),),
            )
        }
    ),
    "DEFI_COMPOR": Command(
        {
            "MONOCRISTAL": Factor(
                {
                    "MATER": Concept(MATERIAL, needed=True),
                    "ELAS": ANY,
                    "ECOULEMENT": Text(("MONO_VISC1",), needed=True),
                    "ECRO_ISOT": Text(("MONO_ISOT1", "MONO_ISOT2"), needed=True),
                    "ECRO_CINE": Text(("MONO_CINE1", "MONO_CINE2"), needed=True),
                    "FAMI_SYST_GLIS": Text(
                        ("OCTAEDRIQUE", "BCC24", "CUBIQUE1", "CUBIQUE2", "ZIRCONIUM", "UNIAXIAL")
                    ),
                },
                needed=True,
                most=5,
            ),
            "MATR_INTER": Concept(("CREA_TABLE",)),
        }
    ),
    "AFFE_MATERIAU": Command(
        {
            "MAILLAGE": MESH,
            "MODELE": Concept(MODEL.makers),
            "AFFE": Factor(
                {
                    "TOUT": YES,
                    "GROUP_MA": NAMES,
                    "MATER": Concept(MATERIAL, needed=True, most=30),
                },
                rules=(one_of("TOUT", "GROUP_MA"),),
                needed=True,
            ),
        },
        rules=(some_of("MAILLAGE", "MODELE"),),
    ),
    "AFFE_CARA_ELEM": Command(
        {
            "MODELE": MODEL,
            "MASSIF": Factor(
                {
                    "GROUP_MA": NEEDED_NAMES,
                    "ANGL_EULER": Number(most=3),
                    "ANGL_REP": Number(most=3),
                },
                rules=(one_of("ANGL_EULER", "ANGL_REP"),),
                needed=True,
            ),
        }
    ),
    "FORMULE": Command(
        {"NOM_PARA": NEEDED_NAMES, "VALE": ANY, "VALE_C": ANY},
        rules=(one_of("VALE", "VALE_C"),),
        constants=True,
    ),
    "AFFE_CHAR_CINE_F": Command(
        {
            "MODELE": MODEL,
            "MECA_IMPO": Factor(
                {"TOUT": YES, "GROUP_MA": NAMES, "GROUP_NO": NAMES}
                | dict.fromkeys(DIRECTIONS, FUNCTION),
                rules=(one_of("TOUT", "GROUP_MA", "GROUP_NO"), some_of(*DIRECTIONS)),
                needed=True,
            ),
        }
    ),
    "DEFI_LIST_REEL": Command({"VALE": Number(needed=True, most=MANY)}),
    "DEFI_LIST_INST": Command(
        {
            "METHODE": Text(("MANUEL", "AUTO")),
            "DEFI_LIST": Factor(
                {"LIST_INST": TIMES, "VALE": REALS},
                rules=(one_of("LIST_INST", "VALE"),),
                needed=True,
                most=1,
            ),
            "ECHEC": Factor(
                {
                    "EVENEMENT": Text(("ERREUR",)),
                    "ACTION": Text(("DECOUPE",)),
                    "SUBD_METHODE": Text(("MANUEL",)),
                    "SUBD_PAS": Number(whole=True, least=2),
                    "SUBD_NIVEAU": Number(whole=True, least=2),
                    "SUBD_PAS_MINI": Number(least=0.0),
                }
            ),
        }
    ),
    "STAT_NON_LINE": Command(
        {
            "MODELE": MODEL,
            "CHAM_MATER": Concept(("AFFE_MATERIAU",), needed=True),
            "CARA_ELEM": Concept(("AFFE_CARA_ELEM",)),
            "EXCIT": Factor({"CHARGE": Concept(("AFFE_CHAR_CINE_F",), needed=True)}),
            "COMPORTEMENT": Factor(
                {
                    "TOUT": YES,
                    "GROUP_MA": NAMES,
                    "RELATION": Text(("MONOCRISTAL",), needed=True),
                    "COMPOR": Concept(("DEFI_COMPOR",), needed=True),
                    "RESI_INTE_RELA": REAL,
                    "ITER_INTE_MAXI": Number(whole=True),
                    "DEFORMATION": Text(("PETIT", "PETIT_REAC", "SIMO_MIEHE")),
                    "ALGO_INTE": Text(("NEWTON", "NEWTON_RELI", "NEWTON_PERT", "RUNGE_KUTTA")),
                },
                rules=(at_most_one_of("TOUT", "GROUP_MA"),),
            ),
            "INCREMENT": Factor(
                {"LIST_INST": Concept(("DEFI_LIST_REEL", "DEFI_LIST_INST"), needed=True)},
                needed=True,
                most=1,
            ),
            "NEWTON": Factor(
                {
                    "MATRICE": Text(("TANGENTE", "ELASTIQUE")),
                    "PREDICTION": Text(("TANGENTE", "ELASTIQUE", "EXTRAPOLE", "DEPL_CALCULE")),
                    "REAC_INCR": Number(whole=True, least=0),
                    "REAC_ITER": Number(whole=True, least=0),
                },
                most=1,
            ),
            "CONVERGENCE": Factor(
                {
                    "RESI_GLOB_RELA": REAL,
                    "RESI_GLOB_MAXI": REAL,
                    "ITER_GLOB_MAXI": Number(whole=True),
                },
                most=1,
            ),
            "ARCHIVAGE": Factor(
                {"LIST_INST": TIMES, "INST": REALS, "PAS_ARCH": Number(whole=True)},
                rules=(at_most_one_of("LIST_INST", "INST", "PAS_ARCH"),),
                most=1,
            ),
            "SOLVEUR": Factor(
                {"METHODE": Text(("MUMPS", "MULT_FRONT", "LDLT", "GCPC", "PETSC"))}, most=1
            ),
        }
    ),
    "CALC_CHAMP": Command(
        {
            "reuse": RESULT,
            "RESULTAT": NEEDED_RESULT,
            "FORCE": Text(("FORC_NODA", "REAC_NODA"), needed=True, most=MANY),
        }
    ),
    "POST_RELEVE_T": Command(
        {
            "ACTION": Factor(
                {
                    "OPERATION": Text(("EXTRACTION",), needed=True),
                    "INTITULE": NEEDED,
                    "RESULTAT": NEEDED_RESULT,
                    "NOM_CHAM": Text(FIELDS, needed=True),
                    "GROUP_NO": NEEDED_NAMES,
                    "TOUT_CMP": YES,
                    "NOM_CMP": NAMES,
                    "RESULTANTE": Text(DIRECTIONS, most=MANY),
                    "TOUT_ORDRE": YES,
                    "INST": REALS,
                    "LIST_INST": TIMES,
                },
                rules=(
                    one_of("TOUT_CMP", "NOM_CMP", "RESULTANTE"),
                    at_most_one_of("TOUT_ORDRE", "INST", "LIST_INST"),
                ),
                needed=True,
            )
        }
    ),
    "IMPR_TABLE": Command(
        {
            "TABLE": Concept(("CREA_TABLE", "POST_RELEVE_T"), needed=True),
            "FORMAT": Text(("TABLEAU",)),
            "SEPARATEUR": ANY,
            "UNITE": UNIT,
            "FORMAT_R": ANY,
            "NOM_PARA": NAMES,
        }
    ),
    "IMPR_RESU": Command(
        {
            "FORMAT": Text(("MED",)),
            "UNITE": UNIT,
            "RESU": Factor(
                {
                    "RESULTAT": NEEDED_RESULT,
                    "NOM_CHAM": Text(FIELDS, most=MANY),
                    "TOUT_CHAM": YES,
                },
                rules=(at_most_one_of("NOM_CHAM", "TOUT_CHAM"),),
                needed=True,
            ),
        }
    ),
    "FIN": Command({}),
}


def faults(text: str) -> list[str]:
    """What Code_Aster 15, 16 or 17 would refuse of a command file, a sentence for each fault.

    Args:
        text: the command file.
    """
    try:
        tree = ast.parse(text)
    except SyntaxError as error:
        return [f"line {error.lineno}: {error.msg}"]
    reader = _Reader()
    reader.visit(tree)
    reader.visit_bodies()
    return reader.faults


# What a command file has without setting it.
_GIVEN = {*dir(builtins), "_F", *COMMANDS}
# What a formula has beside its parameters and constants.
_OF_FORMULAS = {*dir(builtins), *dir(math)}


class _Reader(ast.NodeVisitor):
    """A walk through a command file in the order in which it runs."""

    def __init__(self) -> None:
        self.faults: list[str] = []
        self._line = 0
        self._names = set(_GIVEN)
        self._values: dict[str, ast.expr] = {}
        self._functions: list[ast.FunctionDef] = []

    def visit_bodies(self) -> None:
        """Read the bodies of functions, which may name what is set after them."""
        for function in self._functions:
            with self._scope():
                self.visit(function.args)
                self._visit_all(function.body)

    def visit_Assign(self, node: ast.Assign) -> None:
        self.visit(node.value)
        self._visit_all(node.targets)
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            self._values[node.targets[0].id] = self._resolved(node.value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self.visit(node.value)
        if isinstance(node.target, ast.Name):
            self._require(node.target)
            self._values.pop(node.target.id, None)
        else:
            self.visit(node.target)

    def visit_For(self, node: ast.For) -> None:
        self._visit_all([node.iter, node.target, *node.body, *node.orelse])

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._visit_all([*node.decorator_list, *node.args.defaults])
        self._names.add(node.name)
        self._functions.append(node)

    def visit_Import(self, node: ast.Import | ast.ImportFrom) -> None:
        self._names |= {alias.asname or alias.name.split(".")[0] for alias in node.names}

    visit_ImportFrom = visit_Import

    def visit_ListComp(self, node: ast.ListComp | ast.GeneratorExp | ast.SetComp) -> None:
        with self._scope():
            self._visit_all([*node.generators, node.elt])

    visit_GeneratorExp = visit_SetComp = visit_ListComp

    def visit_DictComp(self, node: ast.DictComp) -> None:
        with self._scope():
            self._visit_all([*node.generators, node.key, node.value])

    def visit_comprehension(self, node: ast.comprehension) -> None:
        self._visit_all([node.iter, node.target, *node.ifs])

    def visit_Lambda(self, node: ast.Lambda) -> None:
        with self._scope():
            self._visit_all([node.args, node.body])

    def visit_arg(self, node: ast.arg) -> None:
        self._names.add(node.arg)

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, ast.Load):
            self._require(node)
        else:
            self._names.add(node.id)
            self._values.pop(node.id, None)

    def visit_Call(self, node: ast.Call) -> None:
        name = _called(node)
        if name in COMMANDS:
            self._command(name, node)
        elif name.isupper() and name not in self._names:
            self._line = node.lineno
            self._say(f"{name} is no known command")
            self._visit_all([*node.args, *node.keywords])
            return
        self.generic_visit(node)

    def _command(self, name: str, node: ast.Call) -> None:
        self._line = node.lineno
        command = COMMANDS[name]
        words = self._keywords(node, name)
        if command.constants:
            self._formula(words)
            words = {word: value for word, value in words.items() if word in command.keywords}
        self._check(words, command.keywords, command.rules, name)

    def _keywords(self, node: ast.Call, where: str) -> dict[str, ast.expr]:
        """Keywords of a call and their values, those of `**NAME` among them."""
        if node.args:
            self._say(f"{where} has a value without a keyword")
        words: dict[str, ast.expr] = {}
        for keyword in node.keywords:
            if keyword.arg is not None:
                given = {keyword.arg: keyword.value}
            else:
                given = self._occurrence(keyword.value, f"** in {where}")
            for word in words.keys() & given:
                self._say(f"{where} has {word} twice")
            words |= given
        return words

    def _occurrence(self, value: ast.expr, where: str) -> dict[str, ast.expr]:
        """Keywords of an `_F(...)` or `dict(...)`."""
        value = self._resolved(value)
        if isinstance(value, ast.Call) and _called(value) in ("_F", "dict"):
            return self._keywords(value, where)
        self._say(f"{where} is no _F(...)")
        return {}

    def _check(
        self,
        words: Mapping[str, ast.expr],
        known: Mapping[str, Keyword],
        rules: tuple[Count | Needs, ...],
        where: str,
    ) -> None:
        for word, value in words.items():
            if word in known:
                self._value(value, known[word], f"{where}/{word}")
            else:
                self._say(f"{where} has no keyword {word}")
        for word, keyword in known.items():
            if keyword.needed and word not in words:
                self._say(f"{where} lacks {word}")
        for rule in rules:
            if fault := rule.fault(words):
                self._say(f"{where} {fault}")

    def _value(self, value: ast.expr, keyword: Keyword, where: str) -> None:
        items = self._items(value)
        if not items:
            self._say(f"{where} is empty")
        elif len(items) > keyword.most:
            self._say(f"{where} has {len(items)} values; expected {keyword.most} at most")
        for item in items:
            match keyword:
                case Text():
                    self._text(item, keyword, where)
                case Number():
                    self._number(item, keyword, where)
                case Concept(makers):
                    if not (isinstance(item, ast.Call) and _called(item) in makers):
                        self._say(f"{where} is not made by {' or '.join(makers)}")
                case Factor(keywords, rules):
                    self._check(self._occurrence(item, where), keywords, rules, where)

    def _text(self, item: ast.expr, keyword: Text, where: str) -> None:
        word = _constant(item)
        if not isinstance(word, str):
            self._say(f"{where} is no text")
        elif keyword.words and word not in keyword.words:
            self._say(f"{where} is {word!r}; expected {' or '.join(keyword.words)}")

    def _number(self, item: ast.expr, keyword: Number, where: str) -> None:
        """Judge a number that stands in the file; one that is computed passes."""
        number = _constant(item)
        if isinstance(item, ast.JoinedStr) or (isinstance(item, ast.Call) and _is_command(item)):
            self._say(f"{where} is no number")
        elif number is None:
            return
        elif not isinstance(number, int if keyword.whole else int | float):
            self._say(f"{where} is no {'whole ' if keyword.whole else ''}number")
        elif number < keyword.least:
            self._say(f"{where} is {number}; expected {keyword.least:g} or more")

    def _formula(self, words: Mapping[str, ast.expr]) -> None:
        """Judge the names in the expression of a formula."""
        known = {*words, *_OF_FORMULAS, *map(_constant, self._items(words.get("NOM_PARA")))}
        for value in self._items(words.get("VALE")):
            expression = _constant(value)
            if not isinstance(expression, str):
                continue
            try:
                tree = ast.parse(expression.strip(), mode="eval")
            except SyntaxError as error:
                self._say(f"FORMULE/VALE: {error.msg}")
                continue
            names = (node.id for node in ast.walk(tree) if isinstance(node, ast.Name))
            for name in names:
                if name not in known:
                    self._say(f"FORMULE/VALE names {name}, which is not defined")

    def _items(self, value: ast.expr | None) -> list[ast.expr]:
        """The values of a keyword, one where it is no list that stands in the file."""
        if value is None:
            return []
        value = self._resolved(value)
        if isinstance(value, ast.Tuple | ast.List):
            return [self._resolved(item) for item in value.elts]
        return [value]

    def _resolved(self, value: ast.expr) -> ast.expr:
        """The expression that a name was set to, or the expression itself."""
        if isinstance(value, ast.Name):
            return self._values.get(value.id, value)
        return value

    def _require(self, node: ast.Name) -> None:
        if node.id not in self._names:
            self._line = node.lineno
            self._say(f"{node.id} is not defined")

    def _visit_all(self, nodes: Sequence[ast.AST]) -> None:
        for node in nodes:
            self.visit(node)

    @contextmanager
    def _scope(self) -> Iterator[None]:
        names = set(self._names)
        yield
        self._names = names

    def _say(self, sentence: str) -> None:
        self.faults.append(f"line {self._line}: {sentence}")


def _called(node: ast.Call) -> str:
    """The name that is called, or none."""
    return node.func.id if isinstance(node.func, ast.Name) else ""


def _is_command(node: ast.Call) -> bool:
    return _called(node) in {*COMMANDS, "_F"}


def _constant(node: ast.expr) -> object:
    """The text or number that an expression writes out, else None."""
    try:
        value: object = ast.literal_eval(node)
    except ValueError:
        return None
    return value
