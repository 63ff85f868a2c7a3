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
        4,1,33,185,2,0,7,0,2,1,7,1,2,2,7,2,2,3,7,3,2,4,7,4,2,5,7,5,2,6,7,
        6,2,7,7,7,2,8,7,8,2,9,7,9,2,10,7,10,2,11,7,11,2,12,7,12,1,0,5,0,
        28,8,0,10,0,12,0,31,9,0,1,0,1,0,1,0,4,0,36,8,0,11,0,12,0,37,3,0,
        40,8,0,1,0,1,0,1,0,1,0,1,0,3,0,47,8,0,1,0,4,0,50,8,0,11,0,12,0,51,
        5,0,54,8,0,10,0,12,0,57,9,0,1,0,1,0,1,1,1,1,1,1,1,1,1,1,1,2,1,2,
        1,2,1,2,1,2,1,2,1,2,1,2,1,2,3,2,75,8,2,3,2,77,8,2,1,2,1,2,1,3,3,
        3,82,8,3,1,3,1,3,1,3,5,3,87,8,3,10,3,12,3,90,9,3,1,4,1,4,1,5,1,5,
        1,5,1,5,1,5,1,5,1,6,3,6,101,8,6,1,6,1,6,1,6,1,6,3,6,107,8,6,1,7,
        3,7,110,8,7,1,7,1,7,1,8,1,8,3,8,116,8,8,1,8,1,8,1,9,1,9,1,9,3,9,
        123,8,9,1,9,1,9,1,9,3,9,128,8,9,1,9,5,9,131,8,9,10,9,12,9,134,9,
        9,1,10,1,10,3,10,138,8,10,1,10,1,10,5,10,142,8,10,10,10,12,10,145,
        9,10,1,10,1,10,1,10,1,10,1,10,1,10,1,10,1,10,1,10,1,10,1,10,1,10,
        1,10,5,10,160,8,10,10,10,12,10,163,9,10,1,10,1,10,3,10,167,8,10,
        1,11,1,11,1,11,1,11,1,11,1,11,1,11,3,11,176,8,11,1,12,3,12,179,8,
        12,1,12,1,12,3,12,183,8,12,1,12,0,0,13,0,2,4,6,8,10,12,14,16,18,
        20,22,24,0,5,4,0,1,7,11,11,14,14,28,33,1,0,5,6,1,0,16,17,2,0,20,
        20,22,22,3,0,7,7,11,11,14,14,206,0,29,1,0,0,0,2,60,1,0,0,0,4,65,
        1,0,0,0,6,81,1,0,0,0,8,91,1,0,0,0,10,93,1,0,0,0,12,100,1,0,0,0,14,
        109,1,0,0,0,16,115,1,0,0,0,18,119,1,0,0,0,20,143,1,0,0,0,22,168,
        1,0,0,0,24,178,1,0,0,0,26,28,5,23,0,0,27,26,1,0,0,0,28,31,1,0,0,
        0,29,27,1,0,0,0,29,30,1,0,0,0,30,39,1,0,0,0,31,29,1,0,0,0,32,33,
        5,1,0,0,33,35,5,11,0,0,34,36,5,23,0,0,35,34,1,0,0,0,36,37,1,0,0,
        0,37,35,1,0,0,0,37,38,1,0,0,0,38,40,1,0,0,0,39,32,1,0,0,0,39,40,
        1,0,0,0,40,55,1,0,0,0,41,47,3,2,1,0,42,47,3,4,2,0,43,47,3,10,5,0,
        44,47,3,12,6,0,45,47,3,16,8,0,46,41,1,0,0,0,46,42,1,0,0,0,46,43,
        1,0,0,0,46,44,1,0,0,0,46,45,1,0,0,0,47,49,1,0,0,0,48,50,5,23,0,0,
        49,48,1,0,0,0,50,51,1,0,0,0,51,49,1,0,0,0,51,52,1,0,0,0,52,54,1,
        0,0,0,53,46,1,0,0,0,54,57,1,0,0,0,55,53,1,0,0,0,55,56,1,0,0,0,56,
        58,1,0,0,0,57,55,1,0,0,0,58,59,5,0,0,1,59,1,1,0,0,0,60,61,5,2,0,
        0,61,62,5,11,0,0,62,63,5,3,0,0,63,64,5,11,0,0,64,3,1,0,0,0,65,66,
        5,18,0,0,66,67,5,11,0,0,67,68,5,19,0,0,68,69,5,11,0,0,69,76,5,17,
        0,0,70,77,3,6,3,0,71,74,5,13,0,0,72,73,5,17,0,0,73,75,5,13,0,0,74,
        72,1,0,0,0,74,75,1,0,0,0,75,77,1,0,0,0,76,70,1,0,0,0,76,71,1,0,0,
        0,77,78,1,0,0,0,78,79,5,20,0,0,79,5,1,0,0,0,80,82,5,10,0,0,81,80,
        1,0,0,0,81,82,1,0,0,0,82,83,1,0,0,0,83,88,3,8,4,0,84,85,5,10,0,0,
        85,87,3,8,4,0,86,84,1,0,0,0,87,90,1,0,0,0,88,86,1,0,0,0,88,89,1,
        0,0,0,89,7,1,0,0,0,90,88,1,0,0,0,91,92,7,0,0,0,92,9,1,0,0,0,93,94,
        5,4,0,0,94,95,5,11,0,0,95,96,5,11,0,0,96,97,5,15,0,0,97,98,3,14,
        7,0,98,11,1,0,0,0,99,101,7,1,0,0,100,99,1,0,0,0,100,101,1,0,0,0,
        101,102,1,0,0,0,102,103,5,11,0,0,103,106,5,11,0,0,104,105,5,15,0,
        0,105,107,3,14,7,0,106,104,1,0,0,0,106,107,1,0,0,0,107,13,1,0,0,
        0,108,110,5,9,0,0,109,108,1,0,0,0,109,110,1,0,0,0,110,111,1,0,0,
        0,111,112,5,14,0,0,112,15,1,0,0,0,113,114,5,11,0,0,114,116,5,15,
        0,0,115,113,1,0,0,0,115,116,1,0,0,0,116,117,1,0,0,0,117,118,3,18,
        9,0,118,17,1,0,0,0,119,132,3,20,10,0,120,122,5,30,0,0,121,123,3,
        22,11,0,122,121,1,0,0,0,122,123,1,0,0,0,123,128,1,0,0,0,124,128,
        5,31,0,0,125,128,5,9,0,0,126,128,5,10,0,0,127,120,1,0,0,0,127,124,
        1,0,0,0,127,125,1,0,0,0,127,126,1,0,0,0,128,129,1,0,0,0,129,131,
        3,20,10,0,130,127,1,0,0,0,131,134,1,0,0,0,132,130,1,0,0,0,132,133,
        1,0,0,0,133,19,1,0,0,0,134,132,1,0,0,0,135,137,5,28,0,0,136,138,
        3,22,11,0,137,136,1,0,0,0,137,138,1,0,0,0,138,142,1,0,0,0,139,142,
        5,29,0,0,140,142,5,9,0,0,141,135,1,0,0,0,141,139,1,0,0,0,141,140,
        1,0,0,0,142,145,1,0,0,0,143,141,1,0,0,0,143,144,1,0,0,0,144,166,
        1,0,0,0,145,143,1,0,0,0,146,167,5,11,0,0,147,167,5,12,0,0,148,167,
        5,14,0,0,149,167,5,33,0,0,150,151,5,19,0,0,151,152,3,18,9,0,152,
        153,5,20,0,0,153,167,1,0,0,0,154,155,5,32,0,0,155,156,5,19,0,0,156,
        161,3,18,9,0,157,158,5,17,0,0,158,160,3,18,9,0,159,157,1,0,0,0,160,
        163,1,0,0,0,161,159,1,0,0,0,161,162,1,0,0,0,162,164,1,0,0,0,163,
        161,1,0,0,0,164,165,5,20,0,0,165,167,1,0,0,0,166,146,1,0,0,0,166,
        147,1,0,0,0,166,148,1,0,0,0,166,149,1,0,0,0,166,150,1,0,0,0,166,
        154,1,0,0,0,167,21,1,0,0,0,168,169,5,21,0,0,169,170,3,24,12,0,170,
        175,7,2,0,0,171,172,3,24,12,0,172,173,7,3,0,0,173,176,1,0,0,0,174,
        176,5,20,0,0,175,171,1,0,0,0,175,174,1,0,0,0,176,23,1,0,0,0,177,
        179,5,9,0,0,178,177,1,0,0,0,178,179,1,0,0,0,179,180,1,0,0,0,180,
        182,7,4,0,0,181,183,5,11,0,0,182,181,1,0,0,0,182,183,1,0,0,0,183,
        25,1,0,0,0,25,29,37,39,46,51,55,74,76,81,88,100,106,109,115,122,
        127,132,137,141,143,161,166,175,178,182
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
            self.state = 29
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while _la==23:
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
                    if not (_la==23):
                        break



            self.state = 55
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 13691017844) != 0):
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
                    if not (_la==23):
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
            self.state = 76
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [1, 2, 3, 4, 5, 6, 7, 10, 11, 14, 28, 29, 30, 31, 32, 33]:
                self.state = 70
                localctx.location = self.path()
                pass
            elif token in [13]:
                self.state = 71
                localctx.label = self.match(StlParser.STRING)
                self.state = 74
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                if _la==17:
                    self.state = 72
                    self.match(StlParser.COMMA)
                    self.state = 73
                    localctx.link = self.match(StlParser.STRING)


                pass
            else:
                raise NoViableAltException(self)

            self.state = 78
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
            self.state = 81
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==10:
                self.state = 80
                self.match(StlParser.SLASH)


            self.state = 83
            self.part()
            self.state = 88
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while _la==10:
                self.state = 84
                self.match(StlParser.SLASH)
                self.state = 85
                self.part()
                self.state = 90
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
            self.state = 91
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
            self.state = 93
            self.match(StlParser.CONST)
            self.state = 94
            localctx.kind = self.match(StlParser.NAME)
            self.state = 95
            localctx.name = self.match(StlParser.NAME)
            self.state = 96
            self.match(StlParser.EQUALS)
            self.state = 97
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
            self.state = 100
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==5 or _la==6:
                self.state = 99
                localctx.io = self._input.LT(1)
                _la = self._input.LA(1)
                if not(_la==5 or _la==6):
                    localctx.io = self._errHandler.recoverInline(self)
                else:
                    self._errHandler.reportMatch(self)
                    self.consume()


            self.state = 102
            localctx.kind = self.match(StlParser.NAME)
            self.state = 103
            localctx.name = self.match(StlParser.NAME)
            self.state = 106
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==15:
                self.state = 104
                self.match(StlParser.EQUALS)
                self.state = 105
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
            self.state = 109
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==9:
                self.state = 108
                self.match(StlParser.MINUS)


            self.state = 111
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
            self.state = 115
            self._errHandler.sync(self)
            la_ = self._interp.adaptivePredict(self._input,13,self._ctx)
            if la_ == 1:
                self.state = 113
                localctx.name = self.match(StlParser.NAME)
                self.state = 114
                self.match(StlParser.EQUALS)


            self.state = 117
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
            self.state = 119
            self.operand()
            self.state = 132
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 3221227008) != 0):
                self.state = 127
                self._errHandler.sync(self)
                token = self._input.LA(1)
                if token in [30]:
                    self.state = 120
                    self.match(StlParser.BINDING)
                    self.state = 122
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if _la==21:
                        self.state = 121
                        self.interval()


                    pass
                elif token in [31]:
                    self.state = 124
                    self.match(StlParser.INFIX)
                    pass
                elif token in [9]:
                    self.state = 125
                    self.match(StlParser.MINUS)
                    pass
                elif token in [10]:
                    self.state = 126
                    self.match(StlParser.SLASH)
                    pass
                else:
                    raise NoViableAltException(self)

                self.state = 129
                self.operand()
                self.state = 134
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
            self.state = 143
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            while (((_la) & ~0x3f) == 0 and ((1 << _la) & 805306880) != 0):
                self.state = 141
                self._errHandler.sync(self)
                token = self._input.LA(1)
                if token in [28]:
                    self.state = 135
                    self.match(StlParser.TEMPORAL)
                    self.state = 137
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)
                    if _la==21:
                        self.state = 136
                        self.interval()


                    pass
                elif token in [29]:
                    self.state = 139
                    self.match(StlParser.PREFIX)
                    pass
                elif token in [9]:
                    self.state = 140
                    self.match(StlParser.MINUS)
                    pass
                else:
                    raise NoViableAltException(self)

                self.state = 145
                self._errHandler.sync(self)
                _la = self._input.LA(1)

            self.state = 166
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [11]:
                self.state = 146
                self.match(StlParser.NAME)
                pass
            elif token in [12]:
                self.state = 147
                self.match(StlParser.ELEMENT)
                pass
            elif token in [14]:
                self.state = 148
                self.match(StlParser.NUMBER)
                pass
            elif token in [33]:
                self.state = 149
                self.match(StlParser.TRUTH)
                pass
            elif token in [19]:
                self.state = 150
                self.match(StlParser.OPEN)
                self.state = 151
                self.expression()
                self.state = 152
                self.match(StlParser.CLOSE)
                pass
            elif token in [32]:
                self.state = 154
                self.match(StlParser.FUNCTION)
                self.state = 155
                self.match(StlParser.OPEN)
                self.state = 156
                self.expression()
                self.state = 161
                self._errHandler.sync(self)
                _la = self._input.LA(1)
                while _la==17:
                    self.state = 157
                    self.match(StlParser.COMMA)
                    self.state = 158
                    self.expression()
                    self.state = 163
                    self._errHandler.sync(self)
                    _la = self._input.LA(1)

                self.state = 164
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
            self.state = 168
            self.match(StlParser.OPEN_INTERVAL)
            self.state = 169
            self.bound()
            self.state = 170
            _la = self._input.LA(1)
            if not(_la==16 or _la==17):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
            self.state = 175
            self._errHandler.sync(self)
            token = self._input.LA(1)
            if token in [7, 9, 11, 14]:
                self.state = 171
                self.bound()
                self.state = 172
                _la = self._input.LA(1)
                if not(_la==20 or _la==22):
                    self._errHandler.recoverInline(self)
                else:
                    self._errHandler.reportMatch(self)
                    self.consume()
                pass
            elif token in [20]:
                self.state = 174
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
            self.state = 178
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==9:
                self.state = 177
                self.match(StlParser.MINUS)


            self.state = 180
            _la = self._input.LA(1)
            if not((((_la) & ~0x3f) == 0 and ((1 << _la) & 18560) != 0)):
                self._errHandler.recoverInline(self)
            else:
                self._errHandler.reportMatch(self)
                self.consume()
            self.state = 182
            self._errHandler.sync(self)
            _la = self._input.LA(1)
            if _la==11:
                self.state = 181
                self.match(StlParser.NAME)


        except RecognitionException as re:
            localctx.exception = re
            self._errHandler.reportError(self, re)
            self._errHandler.recover(self, re)
        finally:
            self.exitRule()
        return localctx





