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
        4,1,32,178,2,0,7,0,2,1,7,1,2,2,7,2,2,3,7,3,2,4,7,4,2,5,7,5,2,6,7,
        6,2,7,7,7,2,8,7,8,2,9,7,9,2,10,7,10,2,11,7,11,2,12,7,12,1,0,5,0,
        28,8,0,10,0,12,0,31,9,0,1,0,1,0,1,0,4,0,36,8,0,11,0,12,0,37,3,0,
        40,8,0,1,0,1,0,1,0,1,0,1,0,3,0,47,8,0,1,0,4,0,50,8,0,11,0,12,0,51,
        5,0,54,8,0,10,0,12,0,57,9,0,1,0,1,0,1,1,1,1,1,1,1,1,1,1,1,2,1,2,
        1,2,1,2,1,2,1,2,1,2,1,2,1,3,3,3,75,8,3,1,3,1,3,1,3,5,3,80,8,3,10,
        3,12,3,83,9,3,1,4,1,4,1,5,1,5,1,5,1,5,1,5,1,5,1,6,3,6,94,8,6,1,6,
        1,6,1,6,1,6,3,6,100,8,6,1,7,3,7,103,8,7,1,7,1,7,1,8,1,8,3,8,109,
        8,8,1,8,1,8,1,9,1,9,1,9,3,9,116,8,9,1,9,1,9,1,9,3,9,121,8,9,1,9,
        5,9,124,8,9,10,9,12,9,127,9,9,1,10,1,10,3,10,131,8,10,1,10,1,10,
        5,10,135,8,10,10,10,12,10,138,9,10,1,10,1,10,1,10,1,10,1,10,1,10,
        1,10,1,10,1,10,1,10,1,10,1,10,1,10,5,10,153,8,10,10,10,12,10,156,
        9,10,1,10,1,10,3,10,160,8,10,1,11,1,11,1,11,1,11,1,11,1,11,1,11,
        3,11,169,8,11,1,12,3,12,172,8,12,1,12,1,12,3,12,176,8,12,1,12,0,
        0,13,0,2,4,6,8,10,12,14,16,18,20,22,24,0,5,4,0,1,7,11,11,13,13,27,
        32,1,0,5,6,1,0,15,16,2,0,19,19,21,21,3,0,7,7,11,11,13,13,197,0,29,
        1,0,0,0,2,60,1,0,0,0,4,65,1,0,0,0,6,74,1,0,0,0,8,84,1,0,0,0,10,86,
        1,0,0,0,12,93,1,0,0,0,14,102,1,0,0,0,16,108,1,0,0,0,18,112,1,0,0,
        0,20,136,1,0,0,0,22,161,1,0,0,0,24,171,1,0,0,0,26,28,5,22,0,0,27,
        26,1,0,0,0,28,31,1,0,0,0,29,27,1,0,0,0,29,30,1,0,0,0,30,39,1,0,0,
        0,31,29,1,0,0,0,32,33,5,1,0,0,33,35,5,11,0,0,34,36,5,22,0,0,35,34,
        1,0,0,0,36,37,1,0,0,0,37,35,1,0,0,0,37,38,1,0,0,0,38,40,1,0,0,0,
        39,32,1,0,0,0,39,40,1,0,0,0,40,55,1,0,0,0,41,47,3,2,1,0,42,47,3,
        4,2,0,43,47,3,10,5,0,44,47,3,12,6,0,45,47,3,16,8,0,46,41,1,0,0,0,
        46,42,1,0,0,0,46,43,1,0,0,0,46,44,1,0,0,0,46,45,1,0,0,0,47,49,1,
        0,0,0,48,50,5,22,0,0,49,48,1,0,0,0,50,51,1,0,0,0,51,49,1,0,0,0,51,
        52,1,0,0,0,52,54,1,0,0,0,53,46,1,0,0,0,54,57,1,0,0,0,55,53,1,0,0,
        0,55,56,1,0,0,0,56,58,1,0,0,0,57,55,1,0,0,0,58,59,5,0,0,1,59,1,1,
        0,0,0,60,61,5,2,0,0,61,62,5,11,0,0,62,63,5,3,0,0,63,64,5,11,0,0,
        64,3,1,0,0,0,65,66,5,17,0,0,66,67,5,11,0,0,67,68,5,18,0,0,68,69,
        5,11,0,0,69,70,5,16,0,0,70,71,3,6,3,0,71,72,5,19,0,0,72,5,1,0,0,
        0,73,75,5,10,0,0,74,73,1,0,0,0,74,75,1,0,0,0,75,76,1,0,0,0,76,81,
        3,8,4,0,77,78,5,10,0,0,78,80,3,8,4,0,79,77,1,0,0,0,80,83,1,0,0,0,
        81,79,1,0,0,0,81,82,1,0,0,0,82,7,1,0,0,0,83,81,1,0,0,0,84,85,7,0,
        0,0,85,9,1,0,0,0,86,87,5,4,0,0,87,88,5,11,0,0,88,89,5,11,0,0,89,
        90,5,14,0,0,90,91,3,14,7,0,91,11,1,0,0,0,92,94,7,1,0,0,93,92,1,0,
        0,0,93,94,1,0,0,0,94,95,1,0,0,0,95,96,5,11,0,0,96,99,5,11,0,0,97,
        98,5,14,0,0,98,100,3,14,7,0,99,97,1,0,0,0,99,100,1,0,0,0,100,13,
        1,0,0,0,101,103,5,9,0,0,102,101,1,0,0,0,102,103,1,0,0,0,103,104,
        1,0,0,0,104,105,5,13,0,0,105,15,1,0,0,0,106,107,5,11,0,0,107,109,
        5,14,0,0,108,106,1,0,0,0,108,109,1,0,0,0,109,110,1,0,0,0,110,111,
        3,18,9,0,111,17,1,0,0,0,112,125,3,20,10,0,113,115,5,29,0,0,114,116,
        3,22,11,0,115,114,1,0,0,0,115,116,1,0,0,0,116,121,1,0,0,0,117,121,
        5,30,0,0,118,121,5,9,0,0,119,121,5,10,0,0,120,113,1,0,0,0,120,117,
        1,0,0,0,120,118,1,0,0,0,120,119,1,0,0,0,121,122,1,0,0,0,122,124,
        3,20,10,0,123,120,1,0,0,0,124,127,1,0,0,0,125,123,1,0,0,0,125,126,
        1,0,0,0,126,19,1,0,0,0,127,125,1,0,0,0,128,130,5,27,0,0,129,131,
        3,22,11,0,130,129,1,0,0,0,130,131,1,0,0,0,131,135,1,0,0,0,132,135,
        5,28,0,0,133,135,5,9,0,0,134,128,1,0,0,0,134,132,1,0,0,0,134,133,
        1,0,0,0,135,138,1,0,0,0,136,134,1,0,0,0,136,137,1,0,0,0,137,159,
        1,0,0,0,138,136,1,0,0,0,139,160,5,11,0,0,140,160,5,12,0,0,141,160,
        5,13,0,0,142,160,5,32,0,0,143,144,5,18,0,0,144,145,3,18,9,0,145,
        146,5,19,0,0,146,160,1,0,0,0,147,148,5,31,0,0,148,149,5,18,0,0,149,
        154,3,18,9,0,150,151,5,16,0,0,151,153,3,18,9,0,152,150,1,0,0,0,153,
        156,1,0,0,0,154,152,1,0,0,0,154,155,1,0,0,0,155,157,1,0,0,0,156,
        154,1,0,0,0,157,158,5,19,0,0,158,160,1,0,0,0,159,139,1,0,0,0,159,
        140,1,0,0,0,159,141,1,0,0,0,159,142,1,0,0,0,159,143,1,0,0,0,159,
        147,1,0,0,0,160,21,1,0,0,0,161,162,5,20,0,0,162,163,3,24,12,0,163,
        168,7,2,0,0,164,165,3,24,12,0,165,166,7,3,0,0,166,169,1,0,0,0,167,
        169,5,19,0,0,168,164,1,0,0,0,168,167,1,0,0,0,169,23,1,0,0,0,170,
        172,5,9,0,0,171,170,1,0,0,0,171,172,1,0,0,0,172,173,1,0,0,0,173,
        175,7,4,0,0,174,176,5,11,0,0,175,174,1,0,0,0,175,176,1,0,0,0,176,
        25,1,0,0,0,23,29,37,39,46,51,55,74,81,93,99,102,108,115,120,125,
        130,134,136,154,159,168,171,175
    ]

class StlParser ( Parser ):

    grammarFileName = "Stl.g4"

    atn = ATNDeserializer().deserialize(serializedATN())

    decisionsToDFA = [ DFA(ds, i) for i, ds in enumerate(atn.decisionToState) ]

    sharedContextCache = PredictionContextCache()

    literalNames = [ "<INVALID>", "'specification'", "'from'", "'import'", 
                     "'const'", "'input'", "'output'", "'inf'", "<INVALID>", 
                     "'-'", "'/'", "<INVALID>", "<INVALID>", "<INVALID>", 
                     "'='", "':'", "','", "'@'", "'('", "')'", "'['", "']'", 
                     "<INVALID>", "<INVALID>", "<INVALID>", "'/*'" ]

    symbolicNames = [ "<INVALID>", "SPECIFICATION", "FROM", "IMPORT", "CONST", 
                      "INPUT", "OUTPUT", "INF", "SYMBOL", "MINUS", "SLASH", 
                      "NAME", "ELEMENT", "NUMBER", "EQUALS", "COLON", "COMMA", 
                      "AT", "OPEN", "CLOSE", "OPEN_INTERVAL", "CLOSE_INTERVAL", 
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
    RULE_value = 7
    RULE_definition = 8
    RULE_expression = 9
    RULE_operand = 10
    RULE_interval = 11
    RULE_bound = 12

    ruleNames =  [ "specification", "importing", "annotation", "path", "part", 
                   "constant", "declaration", "value", "definition", "expression", 
                   "operand", "interval", "bound" ]

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
    NUMBER=13
    EQUALS=14
    COLON=15
    COMMA=16
    AT=17
    OPEN=18
    CLOSE=19
    OPEN_INTERVAL=20
    CLOSE_INTERVAL=21
    END=22
    COMMENT=23
    SPACE=24
    OPEN_COMMENT=25
    ILLEGAL=26
    TEMPORAL=27
    PREFIX=28
    BINDING=29
    INFIX=30
    FUNCTION=31
    TRUTH=32

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
            self.state = 29
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while _la==22:
                self.state = 26
                self.match(StlParser.END)
                self.state = 31
                self._errHandler.sync(self)
                _la = self._input.LA(1)

            self.state = 39
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==1:
                self.state = 32
                self.match(StlParser.SPECIFICATION)
                self.state = 33
                localctx.name = self.match(StlParser.NAME)
                self.state = 35 
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                while True:
                    self.state = 34
                    self.match(StlParser.END)
                    self.state = 37 
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if not (_la==22):
                        break



            self.state = 55
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 6845512308) != 0):
                self.state = 46
                self._errHandler.sync(self)
                la_ = self._interp.adaptivePredict(self._input,3,self._ctx)
                if la_ == 1:
                    self.state = 41
                    localctx._importing = self.importing()
                    localctx.imports.append(localctx._importing)
                    pass

                elif la_ == 2:
                    self.state = 42
                    localctx._annotation = self.annotation()
                    localctx.annotations.append(localctx._annotation)
                    pass

                elif la_ == 3:
                    self.state = 43
                    localctx._constant = self.constant()
                    localctx.constants.append(localctx._constant)
                    pass

                elif la_ == 4:
                    self.state = 44
                    localctx._declaration = self.declaration()
                    localctx.declarations.append(localctx._declaration)
                    pass

                elif la_ == 5:
                    self.state = 45
                    localctx._definition = self.definition()
                    localctx.definitions.append(localctx._definition)
                    pass


                self.state = 49 
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                while True:
                    self.state = 48
                    self.match(StlParser.END)
                    self.state = 51 
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if not (_la==22):
                        break

                self.state = 57
                self._errHandler.sync(self)
                _la = self._input.LA(1)

            self.state = 58
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
            self.name = None # Token

        def FROM(self):
            return self.getToken(StlParser.FROM, 0)

        def IMPORT(self):
            return self.getToken(StlParser.IMPORT, 0)

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def getRuleIndex(self):
            return StlParser.RULE_importing




    def importing(self):

        localctx = StlParser.ImportingContext(self, self._ctx, self.state)
        self.enterRule(localctx, 2, self.RULE_importing)
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 60
            self.match(StlParser.FROM)
            self.state = 61
            localctx.module = self.match(StlParser.NAME)
            self.state = 62
            self.match(StlParser.IMPORT)
            self.state = 63
            localctx.name = self.match(StlParser.NAME)
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

        def AT(self):
            return self.getToken(StlParser.AT, 0)

        def OPEN(self):
            return self.getToken(StlParser.OPEN, 0)

        def COMMA(self):
            return self.getToken(StlParser.COMMA, 0)

        def CLOSE(self):
            return self.getToken(StlParser.CLOSE, 0)

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def path(self):
            return self.getTypedRuleContext(StlParser.PathContext,0)


        def getRuleIndex(self):
            return StlParser.RULE_annotation




    def annotation(self):

        localctx = StlParser.AnnotationContext(self, self._ctx, self.state)
        self.enterRule(localctx, 4, self.RULE_annotation)
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 65
            self.match(StlParser.AT)
            self.state = 66
            localctx.kind = self.match(StlParser.NAME)
            self.state = 67
            self.match(StlParser.OPEN)
            self.state = 68
            localctx.variable = self.match(StlParser.NAME)
            self.state = 69
            self.match(StlParser.COMMA)
            self.state = 70
            localctx.location = self.path()
            self.state = 71
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
            self.state = 74
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==10:
                self.state = 73
                self.match(StlParser.SLASH)


            self.state = 76
            self.part()
            self.state = 81
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while _la==10:
                self.state = 77
                self.match(StlParser.SLASH)
                self.state = 78
                self.part()
                self.state = 83
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
            self.state = 84
            _la = self._input.LA(1)
            if not((((_la) & ~0x3f) == 0 and ((1 << _la) & 8455727358) != 0)):
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
            self.state = 86
            self.match(StlParser.CONST)
            self.state = 87
            localctx.kind = self.match(StlParser.NAME)
            self.state = 88
            localctx.name = self.match(StlParser.NAME)
            self.state = 89
            self.match(StlParser.EQUALS)
            self.state = 90
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
            self.default = None # ValueContext

        def NAME(self, i:int=None):
            if i is None:
                return self.getTokens(StlParser.NAME)
            else:
                return self.getToken(StlParser.NAME, i)

        def EQUALS(self):
            return self.getToken(StlParser.EQUALS, 0)

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
            self.state = 93
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==5 or _la==6:
                self.state = 92
                localctx.io = self._input.LT(1)
                _la = self._input.LA(1)
                if not(_la==5 or _la==6):
                    localctx.io = self._errHandler.recoverInline(self)
                else:
                    self._errHandler.reportMatch(self)
                    self.consume()


            self.state = 95
            localctx.kind = self.match(StlParser.NAME)
            self.state = 96
            localctx.name = self.match(StlParser.NAME)
            self.state = 99
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==14:
                self.state = 97
                self.match(StlParser.EQUALS)
                self.state = 98
                localctx.default = self.value()


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
        self.enterRule(localctx, 14, self.RULE_value)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 102
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==9:
                self.state = 101
                self.match(StlParser.MINUS)


            self.state = 104
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
        self.enterRule(localctx, 16, self.RULE_definition)
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 108
            self._errHandler.sync(self)
            la_ = self._interp.adaptivePredict(self._input,11,self._ctx)
            if la_ == 1:
                self.state = 106
                localctx.name = self.match(StlParser.NAME)
                self.state = 107
                self.match(StlParser.EQUALS)


            self.state = 110
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
        self.enterRule(localctx, 18, self.RULE_expression)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 112
            self.operand()
            self.state = 125
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 1610614272) != 0):
                self.state = 120
                self._errHandler.sync(self)
                token = self._input.LA(1)
                if token in [29]:
                    self.state = 113
                    self.match(StlParser.BINDING)
                    self.state = 115
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if _la==20:
                        self.state = 114
                        self.interval()


                    pass
                elif token in [30]:
                    self.state = 117
                    self.match(StlParser.INFIX)
                    pass
                elif token in [9]:
                    self.state = 118
                    self.match(StlParser.MINUS)
                    pass
                elif token in [10]:
                    self.state = 119
                    self.match(StlParser.SLASH)
                    pass
                else:
                    raise NoViableAltException(self)

                self.state = 122
                self.operand()
                self.state = 127
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
        self.enterRule(localctx, 20, self.RULE_operand)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 136
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 402653696) != 0):
                self.state = 134
                self._errHandler.sync(self)
                token = self._input.LA(1)
                if token in [27]:
                    self.state = 128
                    self.match(StlParser.TEMPORAL)
                    self.state = 130
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if _la==20:
                        self.state = 129
                        self.interval()


                    pass
                elif token in [28]:
                    self.state = 132
                    self.match(StlParser.PREFIX)
                    pass
                elif token in [9]:
                    self.state = 133
                    self.match(StlParser.MINUS)
                    pass
                else:
                    raise NoViableAltException(self)

                self.state = 138
                self._errHandler.sync(self)
                _la = self._input.LA(1)

            self.state = 159
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [11]:
                self.state = 139
                self.match(StlParser.NAME)
                pass
            elif token in [12]:
                self.state = 140
                self.match(StlParser.ELEMENT)
                pass
            elif token in [13]:
                self.state = 141
                self.match(StlParser.NUMBER)
                pass
            elif token in [32]:
                self.state = 142
                self.match(StlParser.TRUTH)
                pass
            elif token in [18]:
                self.state = 143
                self.match(StlParser.OPEN)
                self.state = 144
                self.expression()
                self.state = 145
                self.match(StlParser.CLOSE)
                pass
            elif token in [31]:
                self.state = 147
                self.match(StlParser.FUNCTION)
                self.state = 148
                self.match(StlParser.OPEN)
                self.state = 149
                self.expression()
                self.state = 154
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                while _la==16:
                    self.state = 150
                    self.match(StlParser.COMMA)
                    self.state = 151
                    self.expression()
                    self.state = 156
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)

                self.state = 157
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
        self.enterRule(localctx, 22, self.RULE_interval)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 161
            self.match(StlParser.OPEN_INTERVAL)
            self.state = 162
            self.bound()
            self.state = 163
            _la = self._input.LA(1)
            if not(_la==15 or _la==16):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
            self.state = 168
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [7, 9, 11, 13]:
                self.state = 164
                self.bound()
                self.state = 165
                _la = self._input.LA(1)
                if not(_la==19 or _la==21):
                    self._errHandler.recoverInline(self)
                else:
                    self._errHandler.reportMatch(self)
                    self.consume()
                pass
            elif token in [19]:
                self.state = 167
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
        self.enterRule(localctx, 24, self.RULE_bound)
        self._la = 0 # Token type
        try:
            self.enterOuterAlt(localctx, 1)
            self.state = 171
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==9:
                self.state = 170
                self.match(StlParser.MINUS)


            self.state = 173
            _la = self._input.LA(1)
            if not((((_la) & ~0x3f) == 0 and ((1 << _la) & 10368) != 0)):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
            self.state = 175
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==11:
                self.state = 174
                self.match(StlParser.NAME)


        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx





