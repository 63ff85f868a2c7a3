# Generated from Stl.g4 by ANTLR 4.13.2
# encoding: utf-8
from antlr4 import *
from io import StringIO
import sys
if sys.version_info[1] > 5:
	from typing import TextIO
else:
	from typing.io import TextIO

def serializedATN():
    return [
        4,1,33,210,2,0,7,0,2,1,7,1,2,2,7,2,2,3,7,3,2,4,7,4,2,5,7,5,2,6,7,
        6,2,7,7,7,2,8,7,8,2,9,7,9,2,10,7,10,2,11,7,11,2,12,7,12,2,13,7,13,
        2,14,7,14,1,0,5,0,32,8,0,10,0,12,0,35,9,0,1,0,1,0,1,0,4,0,40,8,0,
        11,0,12,0,41,3,0,44,8,0,1,0,1,0,1,0,1,0,1,0,3,0,51,8,0,1,0,4,0,54,
        8,0,11,0,12,0,55,5,0,58,8,0,10,0,12,0,61,9,0,1,0,1,0,1,1,1,1,1,1,
        1,1,1,1,1,1,5,1,71,8,1,10,1,12,1,74,9,1,1,2,1,2,1,2,1,2,1,2,1,2,
        1,2,1,2,1,2,3,2,85,8,2,3,2,87,8,2,1,2,1,2,1,3,3,3,92,8,3,1,3,1,3,
        1,3,5,3,97,8,3,10,3,12,3,100,9,3,1,4,1,4,1,5,1,5,1,5,1,5,1,5,1,5,
        1,6,3,6,111,8,6,1,6,1,6,1,6,1,6,3,6,117,8,6,1,6,1,6,3,6,121,8,6,
        1,7,1,7,1,7,1,7,1,7,1,7,1,8,3,8,130,8,8,1,8,1,8,1,9,3,9,135,8,9,
        1,9,1,9,1,10,1,10,3,10,141,8,10,1,10,1,10,1,11,1,11,1,11,3,11,148,
        8,11,1,11,1,11,1,11,3,11,153,8,11,1,11,5,11,156,8,11,10,11,12,11,
        159,9,11,1,12,1,12,3,12,163,8,12,1,12,1,12,5,12,167,8,12,10,12,12,
        12,170,9,12,1,12,1,12,1,12,1,12,1,12,1,12,1,12,1,12,1,12,1,12,1,
        12,1,12,1,12,5,12,185,8,12,10,12,12,12,188,9,12,1,12,1,12,3,12,192,
        8,12,1,13,1,13,1,13,1,13,1,13,1,13,1,13,3,13,201,8,13,1,14,3,14,
        204,8,14,1,14,1,14,3,14,208,8,14,1,14,0,0,15,0,2,4,6,8,10,12,14,
        16,18,20,22,24,26,28,0,5,4,0,1,7,11,11,14,14,28,33,1,0,5,6,1,0,16,
        17,3,0,7,7,11,11,14,14,2,0,20,20,22,22,232,0,33,1,0,0,0,2,64,1,0,
        0,0,4,75,1,0,0,0,6,91,1,0,0,0,8,101,1,0,0,0,10,103,1,0,0,0,12,110,
        1,0,0,0,14,122,1,0,0,0,16,129,1,0,0,0,18,134,1,0,0,0,20,140,1,0,
        0,0,22,144,1,0,0,0,24,168,1,0,0,0,26,193,1,0,0,0,28,203,1,0,0,0,
        30,32,5,23,0,0,31,30,1,0,0,0,32,35,1,0,0,0,33,31,1,0,0,0,33,34,1,
        0,0,0,34,43,1,0,0,0,35,33,1,0,0,0,36,37,5,1,0,0,37,39,5,11,0,0,38,
        40,5,23,0,0,39,38,1,0,0,0,40,41,1,0,0,0,41,39,1,0,0,0,41,42,1,0,
        0,0,42,44,1,0,0,0,43,36,1,0,0,0,43,44,1,0,0,0,44,59,1,0,0,0,45,51,
        3,2,1,0,46,51,3,4,2,0,47,51,3,10,5,0,48,51,3,12,6,0,49,51,3,20,10,
        0,50,45,1,0,0,0,50,46,1,0,0,0,50,47,1,0,0,0,50,48,1,0,0,0,50,49,
        1,0,0,0,51,53,1,0,0,0,52,54,5,23,0,0,53,52,1,0,0,0,54,55,1,0,0,0,
        55,53,1,0,0,0,55,56,1,0,0,0,56,58,1,0,0,0,57,50,1,0,0,0,58,61,1,
        0,0,0,59,57,1,0,0,0,59,60,1,0,0,0,60,62,1,0,0,0,61,59,1,0,0,0,62,
        63,5,0,0,1,63,1,1,0,0,0,64,65,5,2,0,0,65,66,5,11,0,0,66,67,5,3,0,
        0,67,72,5,11,0,0,68,69,5,17,0,0,69,71,5,11,0,0,70,68,1,0,0,0,71,
        74,1,0,0,0,72,70,1,0,0,0,72,73,1,0,0,0,73,3,1,0,0,0,74,72,1,0,0,
        0,75,76,5,18,0,0,76,77,5,11,0,0,77,78,5,19,0,0,78,79,5,11,0,0,79,
        86,5,17,0,0,80,87,3,6,3,0,81,84,5,13,0,0,82,83,5,17,0,0,83,85,5,
        13,0,0,84,82,1,0,0,0,84,85,1,0,0,0,85,87,1,0,0,0,86,80,1,0,0,0,86,
        81,1,0,0,0,87,88,1,0,0,0,88,89,5,20,0,0,89,5,1,0,0,0,90,92,5,10,
        0,0,91,90,1,0,0,0,91,92,1,0,0,0,92,93,1,0,0,0,93,98,3,8,4,0,94,95,
        5,10,0,0,95,97,3,8,4,0,96,94,1,0,0,0,97,100,1,0,0,0,98,96,1,0,0,
        0,98,99,1,0,0,0,99,7,1,0,0,0,100,98,1,0,0,0,101,102,7,0,0,0,102,
        9,1,0,0,0,103,104,5,4,0,0,104,105,5,11,0,0,105,106,5,11,0,0,106,
        107,5,15,0,0,107,108,3,18,9,0,108,11,1,0,0,0,109,111,7,1,0,0,110,
        109,1,0,0,0,110,111,1,0,0,0,111,112,1,0,0,0,112,113,5,11,0,0,113,
        116,5,11,0,0,114,115,5,11,0,0,115,117,3,14,7,0,116,114,1,0,0,0,116,
        117,1,0,0,0,117,120,1,0,0,0,118,119,5,15,0,0,119,121,3,18,9,0,120,
        118,1,0,0,0,120,121,1,0,0,0,121,13,1,0,0,0,122,123,5,21,0,0,123,
        124,3,16,8,0,124,125,7,2,0,0,125,126,3,16,8,0,126,127,5,22,0,0,127,
        15,1,0,0,0,128,130,5,9,0,0,129,128,1,0,0,0,129,130,1,0,0,0,130,131,
        1,0,0,0,131,132,7,3,0,0,132,17,1,0,0,0,133,135,5,9,0,0,134,133,1,
        0,0,0,134,135,1,0,0,0,135,136,1,0,0,0,136,137,5,14,0,0,137,19,1,
        0,0,0,138,139,5,11,0,0,139,141,5,15,0,0,140,138,1,0,0,0,140,141,
        1,0,0,0,141,142,1,0,0,0,142,143,3,22,11,0,143,21,1,0,0,0,144,157,
        3,24,12,0,145,147,5,30,0,0,146,148,3,26,13,0,147,146,1,0,0,0,147,
        148,1,0,0,0,148,153,1,0,0,0,149,153,5,31,0,0,150,153,5,9,0,0,151,
        153,5,10,0,0,152,145,1,0,0,0,152,149,1,0,0,0,152,150,1,0,0,0,152,
        151,1,0,0,0,153,154,1,0,0,0,154,156,3,24,12,0,155,152,1,0,0,0,156,
        159,1,0,0,0,157,155,1,0,0,0,157,158,1,0,0,0,158,23,1,0,0,0,159,157,
        1,0,0,0,160,162,5,28,0,0,161,163,3,26,13,0,162,161,1,0,0,0,162,163,
        1,0,0,0,163,167,1,0,0,0,164,167,5,29,0,0,165,167,5,9,0,0,166,160,
        1,0,0,0,166,164,1,0,0,0,166,165,1,0,0,0,167,170,1,0,0,0,168,166,
        1,0,0,0,168,169,1,0,0,0,169,191,1,0,0,0,170,168,1,0,0,0,171,192,
        5,11,0,0,172,192,5,12,0,0,173,192,5,14,0,0,174,192,5,33,0,0,175,
        176,5,19,0,0,176,177,3,22,11,0,177,178,5,20,0,0,178,192,1,0,0,0,
        179,180,5,32,0,0,180,181,5,19,0,0,181,186,3,22,11,0,182,183,5,17,
        0,0,183,185,3,22,11,0,184,182,1,0,0,0,185,188,1,0,0,0,186,184,1,
        0,0,0,186,187,1,0,0,0,187,189,1,0,0,0,188,186,1,0,0,0,189,190,5,
        20,0,0,190,192,1,0,0,0,191,171,1,0,0,0,191,172,1,0,0,0,191,173,1,
        0,0,0,191,174,1,0,0,0,191,175,1,0,0,0,191,179,1,0,0,0,192,25,1,0,
        0,0,193,194,5,21,0,0,194,195,3,28,14,0,195,200,7,2,0,0,196,197,3,
        28,14,0,197,198,7,4,0,0,198,201,1,0,0,0,199,201,5,20,0,0,200,196,
        1,0,0,0,200,199,1,0,0,0,201,27,1,0,0,0,202,204,5,9,0,0,203,202,1,
        0,0,0,203,204,1,0,0,0,204,205,1,0,0,0,205,207,7,3,0,0,206,208,5,
        11,0,0,207,206,1,0,0,0,207,208,1,0,0,0,208,29,1,0,0,0,28,33,41,43,
        50,55,59,72,84,86,91,98,110,116,120,129,134,140,147,152,157,162,
        166,168,186,191,200,203,207
    ]

class StlParser ( Parser ):

    grammarFileName = "Stl.g4"

    atn = ATNDeserializer().deserialize(serializedATN())

    decisionsToDFA = [ DFA(ds, i) for i, ds in enumerate(atn.decisionToState) ]

    sharedContextCache = PredictionContextCache()

    literalNames = [ "<INVALID>", "'specification'", "'from'", "'import'", 
                     "'const'", "'input'", "'output'", "'inf'", "<INVALID>", 
                     "'-'", "'/'", "<INVALID>", "<INVALID>", "<INVALID>", 
                     "<INVALID>", "'='", "':'", "','", "'@'", "'('", "')'", 
                     "'['", "']'", "<INVALID>", "<INVALID>", "<INVALID>", 
                     "'/*'" ]

    symbolicNames = [ "<INVALID>", "SPECIFICATION", "FROM", "IMPORT", "CONST", 
                      "INPUT", "OUTPUT", "INF", "SYMBOL", "MINUS", "SLASH", 
                      "NAME", "ELEMENT", "STRING", "NUMBER", "EQUALS", "COLON", 
                      "COMMA", "AT", "OPEN", "CLOSE", "OPEN_INTERVAL", "CLOSE_INTERVAL", 
                      "END", "COMMENT", "SPACE", "OPEN_COMMENT", "ILLEGAL", 
                      "TEMPORAL", "PREFIX", "BINDING", "INFIX", "FUNCTION", 
                      "TRUTH" ]

    RULE_specification = 0
    RULE_importing = 1
    RULE_annotation = 2
    RULE_path = 3
    RULE_part = 4
    RULE_constant = 5
    RULE_declaration = 6
    RULE_range = 7
    RULE_limit = 8
    RULE_value = 9
    RULE_definition = 10
    RULE_expression = 11
    RULE_operand = 12
    RULE_interval = 13
    RULE_bound = 14

    ruleNames =  [ "specification", "importing", "annotation", "path", "part", 
                   "constant", "declaration", "range", "limit", "value", 
                   "definition", "expression", "operand", "interval", "bound" ]

    EOF = Token.EOF
    SPECIFICATION=1
    FROM=2
    IMPORT=3
    CONST=4
    INPUT=5
    OUTPUT=6
    INF=7
    SYMBOL=8
    MINUS=9
    SLASH=10
    NAME=11
    ELEMENT=12
    STRING=13
    NUMBER=14
    EQUALS=15
    COLON=16
    COMMA=17
    AT=18
    OPEN=19
    CLOSE=20
    OPEN_INTERVAL=21
    CLOSE_INTERVAL=22
    END=23
    COMMENT=24
    SPACE=25
    OPEN_COMMENT=26
    ILLEGAL=27
    TEMPORAL=28
    PREFIX=29
    BINDING=30
    INFIX=31
    FUNCTION=32
    TRUTH=33

    def __init__(self, input:TokenStream, output:TextIO = sys.stdout):
        super().__init__(input, output)
        self.checkVersion("4.13.2")
        self._interp = ParserATNSimulator(self, self.atn, self.decisionsToDFA, self.sharedContextCache)
        self._predicates = None




    class SpecificationContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser
            self.name = None # Token
            self._importing = None # ImportingContext
            self.imports = list() # of ImportingContexts
            self._annotation = None # AnnotationContext
            self.annotations = list() # of AnnotationContexts
            self._constant = None # ConstantContext
            self.constants = list() # of ConstantContexts
            self._declaration = None # DeclarationContext
            self.declarations = list() # of DeclarationContexts
            self._definition = None # DefinitionContext
            self.definitions = list() # of DefinitionContexts

        def EOF(self):
            return self.getToken(StlParser.EOF, 0)

        def END(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.END)
            else:
                return self.getToken(StlParser.END, i)

        def SPECIFICATION(self):
            return self.getToken(StlParser.SPECIFICATION, 0)

        def NAME(self):
            return self.getToken(StlParser.NAME, 0)

        def importing(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.ImportingContext)
            else:
                return self.getTypedRuleContext(StlParser.ImportingContext,i)


        def annotation(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.AnnotationContext)
            else:
                return self.getTypedRuleContext(StlParser.AnnotationContext,i)


        def constant(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.ConstantContext)
            else:
                return self.getTypedRuleContext(StlParser.ConstantContext,i)


        def declaration(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.DeclarationContext)
            else:
                return self.getTypedRuleContext(StlParser.DeclarationContext,i)


        def definition(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.DefinitionContext)
            else:
                return self.getTypedRuleContext(StlParser.DefinitionContext,i)


        def getRuleIndex(self):
            return StlParser.RULE_specification




    def specification(self):

        localctx = StlParser.SpecificationContext(self, self._ctx, self.state)
        self.enterRule(localctx, 0, self.RULE_specification)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 33
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while _la==23:
                self.state = 30
                self.match(StlParser.END)
                self.state = 35
                self._errHandler.sync(self)
                _la = self._input.LA(1)

            self.state = 43
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==1:
                self.state = 36
                self.match(StlParser.SPECIFICATION)
                self.state = 37
                localctx.name = self.match(StlParser.NAME)
                self.state = 39 
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                while True:
                    self.state = 38
                    self.match(StlParser.END)
                    self.state = 41 
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if not (_la==23):
                        break



            self.state = 59
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 13691017844) != 0):
                self.state = 50
                self._errHandler.sync(self)
                la_ = self._interp.adaptivePredict(self._input,3,self._ctx)
                if la_ == 1:
                    self.state = 45
                    localctx._importing = self.importing()
                    localctx.imports.append(localctx._importing)
                    pass

                elif la_ == 2:
                    self.state = 46
                    localctx._annotation = self.annotation()
                    localctx.annotations.append(localctx._annotation)
                    pass

                elif la_ == 3:
                    self.state = 47
                    localctx._constant = self.constant()
                    localctx.constants.append(localctx._constant)
                    pass

                elif la_ == 4:
                    self.state = 48
                    localctx._declaration = self.declaration()
                    localctx.declarations.append(localctx._declaration)
                    pass

                elif la_ == 5:
                    self.state = 49
                    localctx._definition = self.definition()
                    localctx.definitions.append(localctx._definition)
                    pass


                self.state = 53 
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                while True:
                    self.state = 52
                    self.match(StlParser.END)
                    self.state = 55 
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if not (_la==23):
                        break

                self.state = 61
                self._errHandler.sync(self)
                _la = self._input.LA(1)

            self.state = 62
            self.match(StlParser.EOF)
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class ImportingContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser
            self.module = None # Token
            self._NAME = None # Token
            self.names = list() # of Tokens

        def FROM(self):
            return self.getToken(StlParser.FROM, 0)

        def IMPORT(self):
            return self.getToken(StlParser.IMPORT, 0)

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def COMMA(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.COMMA)
            else:
                return self.getToken(StlParser.COMMA, i)

        def getRuleIndex(self):
            return StlParser.RULE_importing




    def importing(self):

        localctx = StlParser.ImportingContext(self, self._ctx, self.state)
        self.enterRule(localctx, 2, self.RULE_importing)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 64
            self.match(StlParser.FROM)
            self.state = 65
            localctx.module = self.match(StlParser.NAME)
            self.state = 66
            self.match(StlParser.IMPORT)
            self.state = 67
            localctx._NAME = self.match(StlParser.NAME)
            localctx.names.append(localctx._NAME)
            self.state = 72
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while _la==17:
                self.state = 68
                self.match(StlParser.COMMA)
                self.state = 69
                localctx._NAME = self.match(StlParser.NAME)
                localctx.names.append(localctx._NAME)
                self.state = 74
                self._errHandler.sync(self)
                _la = self._input.LA(1)

        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class AnnotationContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser
            self.kind = None # Token
            self.variable = None # Token
            self.location = None # PathContext
            self.label = None # Token
            self.link = None # Token

        def AT(self):
            return self.getToken(StlParser.AT, 0)

        def OPEN(self):
            return self.getToken(StlParser.OPEN, 0)

        def COMMA(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.COMMA)
            else:
                return self.getToken(StlParser.COMMA, i)

        def CLOSE(self):
            return self.getToken(StlParser.CLOSE, 0)

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def path(self):
            return self.getTypedRuleContext(StlParser.PathContext,0)


        def STRING(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.STRING)
            else:
                return self.getToken(StlParser.STRING, i)

        def getRuleIndex(self):
            return StlParser.RULE_annotation




    def annotation(self):

        localctx = StlParser.AnnotationContext(self, self._ctx, self.state)
        self.enterRule(localctx, 4, self.RULE_annotation)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 75
            self.match(StlParser.AT)
            self.state = 76
            localctx.kind = self.match(StlParser.NAME)
            self.state = 77
            self.match(StlParser.OPEN)
            self.state = 78
            localctx.variable = self.match(StlParser.NAME)
            self.state = 79
            self.match(StlParser.COMMA)
            self.state = 86
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [1, 2, 3, 4, 5, 6, 7, 10, 11, 14, 28, 29, 30, 31, 32, 33]:
                self.state = 80
                localctx.location = self.path()
                pass
            elif token in [13]:
                self.state = 81
                localctx.label = self.match(StlParser.STRING)
                self.state = 84
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                if _la==17:
                    self.state = 82
                    self.match(StlParser.COMMA)
                    self.state = 83
                    localctx.link = self.match(StlParser.STRING)


                pass
            else:
                raise NoViableAltException(self)

            self.state = 88
            self.match(StlParser.CLOSE)
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class PathContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def part(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.PartContext)
            else:
                return self.getTypedRuleContext(StlParser.PartContext,i)


        def SLASH(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.SLASH)
            else:
                return self.getToken(StlParser.SLASH, i)

        def getRuleIndex(self):
            return StlParser.RULE_path




    def path(self):

        localctx = StlParser.PathContext(self, self._ctx, self.state)
        self.enterRule(localctx, 6, self.RULE_path)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 91
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==10:
                self.state = 90
                self.match(StlParser.SLASH)


            self.state = 93
            self.part()
            self.state = 98
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while _la==10:
                self.state = 94
                self.match(StlParser.SLASH)
                self.state = 95
                self.part()
                self.state = 100
                self._errHandler.sync(self)
                _la = self._input.LA(1)

        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class PartContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def NAME(self):
            return self.getToken(StlParser.NAME, 0)

        def NUMBER(self):
            return self.getToken(StlParser.NUMBER, 0)

        def TEMPORAL(self):
            return self.getToken(StlParser.TEMPORAL, 0)

        def PREFIX(self):
            return self.getToken(StlParser.PREFIX, 0)

        def BINDING(self):
            return self.getToken(StlParser.BINDING, 0)

        def INFIX(self):
            return self.getToken(StlParser.INFIX, 0)

        def FUNCTION(self):
            return self.getToken(StlParser.FUNCTION, 0)

        def TRUTH(self):
            return self.getToken(StlParser.TRUTH, 0)

        def INF(self):
            return self.getToken(StlParser.INF, 0)

        def CONST(self):
            return self.getToken(StlParser.CONST, 0)

        def INPUT(self):
            return self.getToken(StlParser.INPUT, 0)

        def OUTPUT(self):
            return self.getToken(StlParser.OUTPUT, 0)

        def SPECIFICATION(self):
            return self.getToken(StlParser.SPECIFICATION, 0)

        def FROM(self):
            return self.getToken(StlParser.FROM, 0)

        def IMPORT(self):
            return self.getToken(StlParser.IMPORT, 0)

        def getRuleIndex(self):
            return StlParser.RULE_part




    def part(self):

        localctx = StlParser.PartContext(self, self._ctx, self.state)
        self.enterRule(localctx, 8, self.RULE_part)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 101
            _la = self._input.LA(1)
            if not((((_la) & ~0x3f) == 0 and ((1 << _la) & 16911452414) != 0)):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class ConstantContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser
            self.kind = None # Token
            self.name = None # Token
            self.default = None # ValueContext

        def CONST(self):
            return self.getToken(StlParser.CONST, 0)

        def EQUALS(self):
            return self.getToken(StlParser.EQUALS, 0)

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def value(self):
            return self.getTypedRuleContext(StlParser.ValueContext,0)


        def getRuleIndex(self):
            return StlParser.RULE_constant




    def constant(self):

        localctx = StlParser.ConstantContext(self, self._ctx, self.state)
        self.enterRule(localctx, 10, self.RULE_constant)
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 103
            self.match(StlParser.CONST)
            self.state = 104
            localctx.kind = self.match(StlParser.NAME)
            self.state = 105
            localctx.name = self.match(StlParser.NAME)
            self.state = 106
            self.match(StlParser.EQUALS)
            self.state = 107
            localctx.default = self.value()
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class DeclarationContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser
            self.io = None # Token
            self.kind = None # Token
            self.name = None # Token
            self.within = None # Token
            self.bounds = None # RangeContext
            self.default = None # ValueContext

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def EQUALS(self):
            return self.getToken(StlParser.EQUALS, 0)

        def range_(self):
            return self.getTypedRuleContext(StlParser.RangeContext,0)


        def value(self):
            return self.getTypedRuleContext(StlParser.ValueContext,0)


        def INPUT(self):
            return self.getToken(StlParser.INPUT, 0)

        def OUTPUT(self):
            return self.getToken(StlParser.OUTPUT, 0)

        def getRuleIndex(self):
            return StlParser.RULE_declaration




    def declaration(self):

        localctx = StlParser.DeclarationContext(self, self._ctx, self.state)
        self.enterRule(localctx, 12, self.RULE_declaration)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 110
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==5 or _la==6:
                self.state = 109
                localctx.io = self._input.LT(1)
                _la = self._input.LA(1)
                if not(_la==5 or _la==6):
                    localctx.io = self._errHandler.recoverInline(self)
                else:
                    self._errHandler.reportMatch(self)
                    self.consume()


            self.state = 112
            localctx.kind = self.match(StlParser.NAME)
            self.state = 113
            localctx.name = self.match(StlParser.NAME)
            self.state = 116
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==11:
                self.state = 114
                localctx.within = self.match(StlParser.NAME)
                self.state = 115
                localctx.bounds = self.range_()


            self.state = 120
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==15:
                self.state = 118
                self.match(StlParser.EQUALS)
                self.state = 119
                localctx.default = self.value()


        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class RangeContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser
            self.lower = None # LimitContext
            self.upper = None # LimitContext

        def OPEN_INTERVAL(self):
            return self.getToken(StlParser.OPEN_INTERVAL, 0)

        def CLOSE_INTERVAL(self):
            return self.getToken(StlParser.CLOSE_INTERVAL, 0)

        def limit(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.LimitContext)
            else:
                return self.getTypedRuleContext(StlParser.LimitContext,i)


        def COLON(self):
            return self.getToken(StlParser.COLON, 0)

        def COMMA(self):
            return self.getToken(StlParser.COMMA, 0)

        def getRuleIndex(self):
            return StlParser.RULE_range




    def range_(self):

        localctx = StlParser.RangeContext(self, self._ctx, self.state)
        self.enterRule(localctx, 14, self.RULE_range)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 122
            self.match(StlParser.OPEN_INTERVAL)
            self.state = 123
            localctx.lower = self.limit()
            self.state = 124
            _la = self._input.LA(1)
            if not(_la==16 or _la==17):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
            self.state = 125
            localctx.upper = self.limit()
            self.state = 126
            self.match(StlParser.CLOSE_INTERVAL)
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class LimitContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def NUMBER(self):
            return self.getToken(StlParser.NUMBER, 0)

        def NAME(self):
            return self.getToken(StlParser.NAME, 0)

        def INF(self):
            return self.getToken(StlParser.INF, 0)

        def MINUS(self):
            return self.getToken(StlParser.MINUS, 0)

        def getRuleIndex(self):
            return StlParser.RULE_limit




    def limit(self):

        localctx = StlParser.LimitContext(self, self._ctx, self.state)
        self.enterRule(localctx, 16, self.RULE_limit)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 129
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==9:
                self.state = 128
                self.match(StlParser.MINUS)


            self.state = 131
            _la = self._input.LA(1)
            if not((((_la) & ~0x3f) == 0 and ((1 << _la) & 18560) != 0)):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class ValueContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def NUMBER(self):
            return self.getToken(StlParser.NUMBER, 0)

        def MINUS(self):
            return self.getToken(StlParser.MINUS, 0)

        def getRuleIndex(self):
            return StlParser.RULE_value




    def value(self):

        localctx = StlParser.ValueContext(self, self._ctx, self.state)
        self.enterRule(localctx, 18, self.RULE_value)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 134
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==9:
                self.state = 133
                self.match(StlParser.MINUS)


            self.state = 136
            self.match(StlParser.NUMBER)
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class DefinitionContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser
            self.name = None # Token
            self.formula = None # ExpressionContext

        def expression(self):
            return self.getTypedRuleContext(StlParser.ExpressionContext,0)


        def EQUALS(self):
            return self.getToken(StlParser.EQUALS, 0)

        def NAME(self):
            return self.getToken(StlParser.NAME, 0)

        def getRuleIndex(self):
            return StlParser.RULE_definition




    def definition(self):

        localctx = StlParser.DefinitionContext(self, self._ctx, self.state)
        self.enterRule(localctx, 20, self.RULE_definition)
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 140
            self._errHandler.sync(self)
            la_ = self._interp.adaptivePredict(self._input,16,self._ctx)
            if la_ == 1:
                self.state = 138
                localctx.name = self.match(StlParser.NAME)
                self.state = 139
                self.match(StlParser.EQUALS)


            self.state = 142
            localctx.formula = self.expression()
        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class ExpressionContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def operand(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.OperandContext)
            else:
                return self.getTypedRuleContext(StlParser.OperandContext,i)


        def BINDING(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.BINDING)
            else:
                return self.getToken(StlParser.BINDING, i)

        def INFIX(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.INFIX)
            else:
                return self.getToken(StlParser.INFIX, i)

        def MINUS(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.MINUS)
            else:
                return self.getToken(StlParser.MINUS, i)

        def SLASH(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.SLASH)
            else:
                return self.getToken(StlParser.SLASH, i)

        def interval(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.IntervalContext)
            else:
                return self.getTypedRuleContext(StlParser.IntervalContext,i)


        def getRuleIndex(self):
            return StlParser.RULE_expression




    def expression(self):

        localctx = StlParser.ExpressionContext(self, self._ctx, self.state)
        self.enterRule(localctx, 22, self.RULE_expression)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 144
            self.operand()
            self.state = 157
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 3221227008) != 0):
                self.state = 152
                self._errHandler.sync(self)
                token = self._input.LA(1)
                if token in [30]:
                    self.state = 145
                    self.match(StlParser.BINDING)
                    self.state = 147
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if _la==21:
                        self.state = 146
                        self.interval()


                    pass
                elif token in [31]:
                    self.state = 149
                    self.match(StlParser.INFIX)
                    pass
                elif token in [9]:
                    self.state = 150
                    self.match(StlParser.MINUS)
                    pass
                elif token in [10]:
                    self.state = 151
                    self.match(StlParser.SLASH)
                    pass
                else:
                    raise NoViableAltException(self)

                self.state = 154
                self.operand()
                self.state = 159
                self._errHandler.sync(self)
                _la = self._input.LA(1)

        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class OperandContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def NAME(self):
            return self.getToken(StlParser.NAME, 0)

        def ELEMENT(self):
            return self.getToken(StlParser.ELEMENT, 0)

        def NUMBER(self):
            return self.getToken(StlParser.NUMBER, 0)

        def TRUTH(self):
            return self.getToken(StlParser.TRUTH, 0)

        def OPEN(self):
            return self.getToken(StlParser.OPEN, 0)

        def expression(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.ExpressionContext)
            else:
                return self.getTypedRuleContext(StlParser.ExpressionContext,i)


        def CLOSE(self):
            return self.getToken(StlParser.CLOSE, 0)

        def FUNCTION(self):
            return self.getToken(StlParser.FUNCTION, 0)

        def TEMPORAL(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.TEMPORAL)
            else:
                return self.getToken(StlParser.TEMPORAL, i)

        def PREFIX(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.PREFIX)
            else:
                return self.getToken(StlParser.PREFIX, i)

        def MINUS(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.MINUS)
            else:
                return self.getToken(StlParser.MINUS, i)

        def COMMA(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.COMMA)
            else:
                return self.getToken(StlParser.COMMA, i)

        def interval(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.IntervalContext)
            else:
                return self.getTypedRuleContext(StlParser.IntervalContext,i)


        def getRuleIndex(self):
            return StlParser.RULE_operand




    def operand(self):

        localctx = StlParser.OperandContext(self, self._ctx, self.state)
        self.enterRule(localctx, 24, self.RULE_operand)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 168
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 805306880) != 0):
                self.state = 166
                self._errHandler.sync(self)
                token = self._input.LA(1)
                if token in [28]:
                    self.state = 160
                    self.match(StlParser.TEMPORAL)
                    self.state = 162
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if _la==21:
                        self.state = 161
                        self.interval()


                    pass
                elif token in [29]:
                    self.state = 164
                    self.match(StlParser.PREFIX)
                    pass
                elif token in [9]:
                    self.state = 165
                    self.match(StlParser.MINUS)
                    pass
                else:
                    raise NoViableAltException(self)

                self.state = 170
                self._errHandler.sync(self)
                _la = self._input.LA(1)

            self.state = 191
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [11]:
                self.state = 171
                self.match(StlParser.NAME)
                pass
            elif token in [12]:
                self.state = 172
                self.match(StlParser.ELEMENT)
                pass
            elif token in [14]:
                self.state = 173
                self.match(StlParser.NUMBER)
                pass
            elif token in [33]:
                self.state = 174
                self.match(StlParser.TRUTH)
                pass
            elif token in [19]:
                self.state = 175
                self.match(StlParser.OPEN)
                self.state = 176
                self.expression()
                self.state = 177
                self.match(StlParser.CLOSE)
                pass
            elif token in [32]:
                self.state = 179
                self.match(StlParser.FUNCTION)
                self.state = 180
                self.match(StlParser.OPEN)
                self.state = 181
                self.expression()
                self.state = 186
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                while _la==17:
                    self.state = 182
                    self.match(StlParser.COMMA)
                    self.state = 183
                    self.expression()
                    self.state = 188
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)

                self.state = 189
                self.match(StlParser.CLOSE)
                pass
            else:
                raise NoViableAltException(self)

        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class IntervalContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def OPEN_INTERVAL(self):
            return self.getToken(StlParser.OPEN_INTERVAL, 0)

        def bound(self, i:int=None):
            if i is None:
                return self.getTypedRuleContexts(StlParser.BoundContext)
            else:
                return self.getTypedRuleContext(StlParser.BoundContext,i)


        def COLON(self):
            return self.getToken(StlParser.COLON, 0)

        def COMMA(self):
            return self.getToken(StlParser.COMMA, 0)

        def CLOSE(self):
            return self.getToken(StlParser.CLOSE, 0)

        def CLOSE_INTERVAL(self):
            return self.getToken(StlParser.CLOSE_INTERVAL, 0)

        def getRuleIndex(self):
            return StlParser.RULE_interval




    def interval(self):

        localctx = StlParser.IntervalContext(self, self._ctx, self.state)
        self.enterRule(localctx, 26, self.RULE_interval)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 193
            self.match(StlParser.OPEN_INTERVAL)
            self.state = 194
            self.bound()
            self.state = 195
            _la = self._input.LA(1)
            if not(_la==16 or _la==17):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
            self.state = 200
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [7, 9, 11, 14]:
                self.state = 196
                self.bound()
                self.state = 197
                _la = self._input.LA(1)
                if not(_la==20 or _la==22):
                    self._errHandler.recoverInline(self)
                else:
                    self._errHandler.reportMatch(self)
                    self.consume()
                pass
            elif token in [20]:
                self.state = 199
                self.match(StlParser.CLOSE)
                pass
            else:
                raise NoViableAltException(self)

        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx


    class BoundContext(ParserRuleContext):
        __slots__ = 'parser'

        def __init__(self, parser, parent:ParserRuleContext=None, invokingState:int=-1):
            super().__init__(parent, invokingState)
            self.parser = parser

        def NUMBER(self):
            return self.getToken(StlParser.NUMBER, 0)

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def INF(self):
            return self.getToken(StlParser.INF, 0)

        def MINUS(self):
            return self.getToken(StlParser.MINUS, 0)

        def getRuleIndex(self):
            return StlParser.RULE_bound




    def bound(self):

        localctx = StlParser.BoundContext(self, self._ctx, self.state)
        self.enterRule(localctx, 28, self.RULE_bound)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 203
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==9:
                self.state = 202
                self.match(StlParser.MINUS)


            self.state = 205
            _la = self._input.LA(1)
            if not((((_la) & ~0x3f) == 0 and ((1 << _la) & 18560) != 0)):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
            self.state = 207
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==11:
                self.state = 206
                self.match(StlParser.NAME)


        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx





